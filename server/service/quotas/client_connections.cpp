#include "server/service/quotas/client_connections.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstring>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"

namespace tessera::server {
namespace {

/// Returns the number of a socket that no other open socket has; 0: `file` is no open socket.
ino_t socket_inode(int file) {
  struct stat info {};
  return ::fstat(file, &info) == 0 && S_ISSOCK(info.st_mode) ? info.st_ino : 0;
}

/// Returns "HOST:PORT" in gRPC's form, without the prefix of the family; "": no TCP address.
std::string address_text(const sockaddr_storage& address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address.ss_family == AF_INET) {
    const auto& ip4 = reinterpret_cast<const sockaddr_in&>(address);
    ::inet_ntop(AF_INET, &ip4.sin_addr, text.data(), text.size());
    return absl::StrCat(text.data(), ":", ntohs(ip4.sin_port));
  }
  if (address.ss_family != AF_INET6) return {};
  const auto& ip6 = reinterpret_cast<const sockaddr_in6&>(address);
  if (IN6_IS_ADDR_V4MAPPED(&ip6.sin6_addr)) {
    ::inet_ntop(AF_INET, &ip6.sin6_addr.s6_addr[12], text.data(), text.size());
    return absl::StrCat(text.data(), ":", ntohs(ip6.sin6_port));
  }
  ::inet_ntop(AF_INET6, &ip6.sin6_addr, text.data(), text.size());
  return absl::StrCat("[", text.data(), "]:", ntohs(ip6.sin6_port));
}

/// Returns the same of gRPC's text of a peer, such as "ipv6:%5Bfe80::1%25eth0%5D:7420"; eth0 is a
/// zone, which address_text() does not have.
std::string address_of_peer(const std::string& peer) {
  std::string text =
      absl::StrReplaceAll(peer.substr(peer.find(':') + 1), {{"%5B", "["}, {"%5D", "]"}});
  const std::size_t zone = text.find('%'), end = text.find(']');
  if (zone < end && end != std::string::npos) text.erase(zone, end - zone);
  return text;
}

/// Ends a connection unless `file` has become another one. gRPC keeps its descriptor.
void cut(int file, ino_t inode) {
  const int copy = ::fcntl(file, F_DUPFD_CLOEXEC, 0);
  if (copy < 0) return;
  if (socket_inode(copy) == inode) ::shutdown(copy, SHUT_RDWR);
  ::close(copy);
}

}  // namespace

void ClientConnections::add(int socket, const sockaddr_storage& peer, Time now) {
  const MutexLock lock(mutex_);
  if (const auto old = sockets_.find(socket); old != sockets_.end()) remove(old);
  Connection connection;
  connection.inode = socket_inode(socket);
  connection.peer = address_text(peer);
  connection.accepted = now;
  by_peer_[connection.peer] = socket;
  sockets_[socket] = std::move(connection);
}

std::size_t ClientConnections::use(const std::string& client, const std::string& peer, double limit,
                                   Time now) {
  const std::string address = address_of_peer(peer);
  const MutexLock lock(mutex_);
  const auto found = by_peer_.find(address);
  if (found == by_peer_.end()) return 0;
  const int socket = found->second;
  Connection& connection = sockets_.at(socket);
  if (!connection.client.empty()) return 0;
  const auto is_above = [limit](std::size_t count) {
    return limit > 0 && static_cast<double>(count) > limit;
  };
  std::size_t count = count_known(client) + 1;
  if (is_above(count)) {
    for (const int ended_socket : ended(client)) remove(sockets_.find(ended_socket));
    count = count_known(client) + 1;
  }
  if (is_above(count)) {
    if (!connection.refused) connection.refused = now;
    return count;
  }
  connection.client = client;
  connection.refused.reset();
  by_client_[client].insert(socket);
  return count;
}

std::size_t ClientConnections::count(const std::string& client) const {
  const MutexLock lock(mutex_);
  return count_known(client) - ended(client).size();
}

std::size_t ClientConnections::count_known(const std::string& client) const {
  const auto found = by_client_.find(client);
  return found == by_client_.end() ? 0 : found->second.size();
}

std::vector<int> ClientConnections::ended(const std::string& client) const {
  std::vector<int> sockets;
  const auto found = by_client_.find(client);
  if (found == by_client_.end()) return sockets;
  for (const int socket : found->second) {
    if (socket_inode(socket) != sockets_.at(socket).inode) sockets.push_back(socket);
  }
  return sockets;
}

void ClientConnections::remove(Sockets::iterator connection) {
  const auto& [socket, entry] = *connection;
  const auto peer = by_peer_.find(entry.peer);
  if (peer != by_peer_.end() && peer->second == socket) by_peer_.erase(peer);
  if (const auto client = by_client_.find(entry.client); client != by_client_.end()) {
    client->second.erase(socket);
    if (client->second.empty()) by_client_.erase(client);
  }
  sockets_.erase(connection);
}

std::size_t ClientConnections::cut_refused(Time now) {
  const MutexLock lock(mutex_);
  std::size_t count = 0;
  for (auto next = sockets_.begin(); next != sockets_.end();) {
    const auto connection = next++;
    const std::optional<Time> refused = connection->second.refused;
    if (!refused || now - *refused < kGrace) continue;
    cut(connection->first, connection->second.inode);
    remove(connection);
    ++count;
  }
  return count;
}

bool ClientConnections::cut_silent(Time now) {
  const MutexLock lock(mutex_);
  auto oldest = sockets_.end();
  for (auto next = sockets_.begin(); next != sockets_.end();) {
    const auto connection = next++;
    const auto& [socket, entry] = *connection;
    if (!entry.client.empty() || now - entry.accepted < kSilence) continue;
    if (socket_inode(socket) != entry.inode) {
      remove(connection);
    } else if (oldest == sockets_.end() || entry.accepted < oldest->second.accepted) {
      oldest = connection;
    }
  }
  if (oldest == sockets_.end()) return false;
  cut(oldest->first, oldest->second.inode);
  remove(oldest);
  return true;
}

}  // namespace tessera::server
