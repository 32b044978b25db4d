#include "server/service/accept_gate.h"

#include <linux/tcp.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr rlim_t kMaxReserve = 256;  // segments, images, the journal, uploads
/// Pause after a refused connection, so that a flood does not use up a CPU.
constexpr int kRefusalPauseMs = 20;
constexpr std::chrono::seconds kWarningPeriod{10};
/// While connections wait, the time between two looks for free places.
constexpr int kAdmissionPeriodMs = 5;

struct HostAndPort {
  std::string host, port;
  bool is_wildcard = false;
};

HostAndPort split_address(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  HostAndPort parts;
  parts.host = address.substr(0, colon);
  parts.port = colon == std::string::npos ? "0" : address.substr(colon + 1);
  if (parts.host.size() > 1 && parts.host.front() == '[' && parts.host.back() == ']') {
    parts.host = parts.host.substr(1, parts.host.size() - 2);
  }
  parts.is_wildcard = parts.host == "0.0.0.0" || parts.host == "::";
  return parts;
}

void set_option(int fd, int level, int option, int value) {
  ::setsockopt(fd, level, option, &value, sizeof value);
}

/// Returns the smallest descriptor that connections must leave free.
int first_reserved_descriptor() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return 768;  // of the usual 1,024
  constexpr rlim_t kMax = 1 << 30;
  const rlim_t count = std::min(limit.rlim_cur, kMax);
  return static_cast<int>(count - std::min(kMaxReserve, count / 2));
}

std::uint16_t port_of(int fd) {
  sockaddr_storage bound{};
  socklen_t size = sizeof bound;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&bound), &size) != 0) return 0;
  return ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                           : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
}

void set_port(sockaddr_storage& where, std::uint16_t port) {
  if (where.ss_family == AF_INET6) {
    reinterpret_cast<sockaddr_in6&>(where).sin6_port = htons(port);
  } else {
    reinterpret_cast<sockaddr_in&>(where).sin_port = htons(port);
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<AcceptGate>> AcceptGate::bind(const std::string& address) {
  const HostAndPort parts = split_address(address);
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  // One IPv6 socket serves both families.
  const char* host = parts.is_wildcard ? "::" : parts.host.c_str();
  if (const int error = ::getaddrinfo(host, parts.port.c_str(), &hints, &found); error != 0) {
    return absl::UnavailableError(
        absl::StrCat("cannot listen on ", address, ": ", ::gai_strerror(error)));
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, ::freeaddrinfo);
  std::unique_ptr<AcceptGate> gate(new AcceptGate);
  absl::Status status = absl::UnavailableError("no address");
  for (const addrinfo* where = found; where != nullptr; where = where->ai_next) {
    status = gate->bind_one(*where, parts.is_wildcard);
    if (absl::IsAlreadyExists(status)) break;  // the port must be free at every address
  }
  if (!status.ok() && parts.is_wildcard && gate->listeners_.empty()) {  // no IPv6 here
    sockaddr_in any{};
    any.sin_family = AF_INET;
    any.sin_port = reinterpret_cast<const sockaddr_in6*>(found->ai_addr)->sin6_port;
    addrinfo where{};
    where.ai_family = AF_INET;
    where.ai_addr = reinterpret_cast<sockaddr*>(&any);
    where.ai_addrlen = sizeof any;
    status = gate->bind_one(where, false);
  }
  if (absl::IsAlreadyExists(status) || gate->listeners_.empty()) {
    return absl::UnavailableError(
        absl::StrCat("cannot listen on ", address, ": ", std::string(status.message())));
  }
  gate->stop_event_ = ::eventfd(0, EFD_CLOEXEC);
  if (gate->stop_event_ < 0) return absl::ErrnoToStatus(errno, "eventfd");
  gate->first_reserved_ = first_reserved_descriptor();
  return gate;
}

absl::Status AcceptGate::bind_one(const addrinfo& where, bool is_wildcard) {
  const int fd = ::socket(where.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return absl::UnavailableError(std::strerror(errno));
  set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1);
  set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);  // accepted sockets inherit it
  if (where.ai_family == AF_INET6) set_option(fd, IPPROTO_IPV6, IPV6_V6ONLY, is_wildcard ? 0 : 1);
  sockaddr_storage bound{};
  std::memcpy(&bound, where.ai_addr, where.ai_addrlen);
  if (port_ != 0) set_port(bound, port_);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&bound), where.ai_addrlen) != 0 ||
      ::listen(fd, SOMAXCONN) != 0) {
    absl::Status status = errno == EADDRINUSE ? absl::AlreadyExistsError(std::strerror(errno))
                                              : absl::UnavailableError(std::strerror(errno));
    ::close(fd);
    return status;
  }
  listeners_.push_back(fd);
  if (port_ == 0) port_ = port_of(fd);
  return absl::OkStatus();
}

AcceptGate::~AcceptGate() {
  stop();
  for (const int fd : listeners_) ::close(fd);
  if (stop_event_ >= 0) ::close(stop_event_);
}

void AcceptGate::start(std::unique_ptr<Acceptor> acceptor, ClientConnections* connections,
                       std::function<void(const std::string&)> warn) {
  acceptor_ = std::move(acceptor);
  connections_ = connections;
  warn_ = std::move(warn);
  thread_ = std::thread([this] { run(); });
}

void AcceptGate::stop() {
  if (!thread_.joinable()) return;
  const std::uint64_t one = 1;
  (void)!::write(stop_event_, &one, sizeof one);
  thread_.join();
}

void AcceptGate::run() {
  std::vector<pollfd> waits;
  for (const int fd : listeners_) waits.push_back({fd, POLLIN, 0});
  waits.push_back({stop_event_, POLLIN, 0});
  auto next_warning = std::chrono::steady_clock::now();
  while (true) {
    const int pause = !queue_.empty() ? kAdmissionPeriodMs : refused_count_ > 0 ? 1000 : -1;
    const int ready = ::poll(waits.data(), waits.size(), pause);
    if (ready < 0 && errno != EINTR) return;
    if ((waits.back().revents & POLLIN) != 0) return;
    bool is_exhausted = false;
    for (std::size_t i = 0; ready > 0 && i < listeners_.size(); ++i) {
      if (waits[i].revents != 0 && accept_from(listeners_[i])) is_exhausted = true;
    }
    admit();
    const auto now = std::chrono::steady_clock::now();
    if (refused_count_ > 0 && now >= next_warning) {
      report_refused();
      next_warning = now + kWarningPeriod;
    }
    if (is_exhausted) ::poll(&waits.back(), 1, kRefusalPauseMs);
  }
}

bool AcceptGate::accept_from(int listener) {
  while (true) {
    sockaddr_storage peer{};
    socklen_t size = sizeof peer;
    const int fd = ::accept4(listener, reinterpret_cast<sockaddr*>(&peer), &size,
                             SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0) {
      if (errno == EINTR || errno == ECONNABORTED) continue;
      if (errno == EAGAIN || errno == EWOULDBLOCK) return false;
      ++refused_count_;  // out of descriptors or memory: the connection stays in the queue
      return true;
    }
    if (fd >= first_reserved_) {
      refuse(fd);
      return true;
    }
    if (connections_ != nullptr) {
      queue_.add({listener, fd, peer});
    } else {
      pass_on({listener, fd, peer});
    }
  }
}

void AcceptGate::admit() {
  if (queue_.empty()) return;
  const auto now = std::chrono::steady_clock::now();
  for (const HandshakeQueue::Connection& connection : queue_.admit(now)) {
    connections_->add(connection.socket, connection.peer, now);
    pass_on(connection);
  }
}

void AcceptGate::pass_on(const HandshakeQueue::Connection& connection) {
  Acceptor::NewConnectionParameters parameters;
  parameters.listener_fd = connection.listener;
  parameters.fd = connection.socket;
  acceptor_->HandleNewConnection(&parameters);
}

void AcceptGate::refuse(int fd) {
  ::close(fd);
  ++refused_count_;
  queue_.drop_one();
  if (connections_ != nullptr) connections_->cut_silent(std::chrono::steady_clock::now());
}

void AcceptGate::report_refused() {
  warn_(absl::StrCat("refused ", std::exchange(refused_count_, 0),
                     " connections: all file descriptors but the reserve are in use; close idle ",
                     "connections or raise the hard limit of open files (ulimit -Hn)"));
}

}  // namespace tessera::server
