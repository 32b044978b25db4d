#include "server/service/handshake_queue.h"

#include <linux/tcp.h>
#include <netinet/in.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>

namespace tessera::server {
namespace {

constexpr std::size_t kPlacesOfOneAddress = HandshakeQueue::kPlaces / 2;

std::string bytes(const void* data, std::size_t size) {
  return {static_cast<const char*>(data), size};
}

/// Returns the bytes of the address without its port.
std::string address_key(const sockaddr_storage& peer) {
  if (peer.ss_family == AF_INET) {
    return bytes(&reinterpret_cast<const sockaddr_in&>(peer).sin_addr, sizeof(in_addr));
  }
  if (peer.ss_family != AF_INET6) return {};
  const in6_addr& ip6 = reinterpret_cast<const sockaddr_in6&>(peer).sin6_addr;
  if (IN6_IS_ADDR_V4MAPPED(&ip6)) return bytes(&ip6.s6_addr[12], sizeof(in_addr));
  return bytes(&ip6, sizeof(in6_addr) / 2);
}

/// Returns whether the handshake over a socket is over. gRPC may have closed the socket.
bool is_over(int socket) {
  tcp_info info{};
  socklen_t size = sizeof info;
  return ::getsockopt(socket, IPPROTO_TCP, TCP_INFO, &info, &size) != 0 ||
         info.tcpi_bytes_received >= HandshakeQueue::kHandshakeBytes;
}

bool is_given_up(int socket) {
  pollfd state{socket, POLLRDHUP, 0};
  return ::poll(&state, 1, 0) > 0;
}

}  // namespace

HandshakeQueue::~HandshakeQueue() {
  for (const auto& [address, queue] : waiting_) {
    for (const Connection& connection : queue) ::close(connection.socket);
  }
}

void HandshakeQueue::add(const Connection& connection) {
  // A connection whose descriptor is used again has ended.
  std::erase_if(places_, [&](const Place& place) { return place.socket == connection.socket; });
  waiting_[address_key(connection.peer)].push_back(connection);
}

std::size_t HandshakeQueue::places_of(const std::string& address) const {
  return static_cast<std::size_t>(
      std::count_if(places_.begin(), places_.end(),
                    [&](const Place& place) { return place.address == address; }));
}

std::vector<HandshakeQueue::Connection> HandshakeQueue::admit(Time now) {
  std::vector<Connection> admitted;
  std::erase_if(places_, [&](const Place& place) {
    return now - place.since >= kPlaceTime || is_over(place.socket);
  });
  std::size_t passed_over = 0;  // addresses since the last one of which a connection was admitted
  while (places_.size() < kPlaces && passed_over < waiting_.size()) {
    auto turn = waiting_.upper_bound(last_admitted_);
    if (turn == waiting_.end()) turn = waiting_.begin();
    auto& [address, queue] = *turn;
    last_admitted_ = address;
    ++passed_over;
    if (places_of(address) >= kPlacesOfOneAddress) continue;
    while (!queue.empty() && is_given_up(queue.back().socket)) {
      ::close(queue.back().socket);
      queue.pop_back();
      passed_over = 0;
    }
    if (!queue.empty()) {
      admitted.push_back(queue.back());
      places_.push_back({queue.back().socket, address, now});
      queue.pop_back();
      passed_over = 0;
    }
    if (queue.empty()) waiting_.erase(turn);
  }
  return admitted;
}

bool HandshakeQueue::drop_one() {
  const auto longest = std::max_element(
      waiting_.begin(), waiting_.end(),
      [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (longest == waiting_.end()) return false;
  ::close(longest->second.back().socket);
  longest->second.pop_back();
  if (longest->second.empty()) waiting_.erase(longest);
  return true;
}

}  // namespace tessera::server
