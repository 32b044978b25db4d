#pragma once

#include <grpcpp/server_builder.h>
#include <netdb.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "server/service/handshake_queue.h"
#include "server/service/quotas/client_connections.h"

namespace tessera::server {

/// Listens on a TCP address, accepts connections and passes them to a gRPC server.
///
/// gRPC's own listener takes the last descriptor of the process and stops for good when there is
/// none. This one leaves some to files: a new descriptor has the lowest free number, so a
/// connection whose number is in the upper part of the limit shows that the lower part is used up.
/// It is closed at once, before any handshake. Of the accepted connections, only those over which
/// no caller has made a call are ended then. If the server tells callers apart, connections that
/// arrive faster than their handshakes can be made wait in a HandshakeQueue.
class AcceptGate {
 public:
  using Acceptor = grpc::experimental::ExternalConnectionAcceptor;

  /// Binds all addresses that `address` (HOST:PORT) resolves to; 0.0.0.0 and [::] mean every
  /// address of both families. Port 0: any free port. Errors: Unavailable, naming the reason.
  static absl::StatusOr<std::unique_ptr<AcceptGate>> bind(const std::string& address);
  ~AcceptGate();
  AcceptGate(const AcceptGate&) = delete;
  AcceptGate& operator=(const AcceptGate&) = delete;

  std::uint16_t port() const { return port_; }
  /// Starts to accept, until stop(). `warn` is called when connections were refused, at most every
  /// 10 s, on the gate's thread. `connections` is told of every connection; null: the server does
  /// not tell callers apart.
  void start(std::unique_ptr<Acceptor> acceptor, ClientConnections* connections,
             std::function<void(const std::string&)> warn);
  void stop();

 private:
  AcceptGate() = default;
  /// Errors: AlreadyExists, the port is in use; Unavailable, another reason.
  absl::Status bind_one(const addrinfo& where, bool is_wildcard);
  void run();
  /// Accepts all pending connections of a listening socket; returns whether descriptors ran out.
  bool accept_from(int listener);
  void refuse(int fd);
  /// Passes on the waiting connections for which there are places.
  void admit();
  void pass_on(const HandshakeQueue::Connection& connection);
  void report_refused();

  std::vector<int> listeners_;
  int stop_event_ = -1;  // eventfd
  std::uint16_t port_ = 0;
  int first_reserved_ = 0;  // smallest descriptor that is kept for files
  std::unique_ptr<Acceptor> acceptor_;
  ClientConnections* connections_ = nullptr;
  HandshakeQueue queue_;  // unused if connections_ is null
  std::function<void(const std::string&)> warn_;
  std::int64_t refused_count_ = 0;  // since the last warning
  std::thread thread_;
};

}  // namespace tessera::server
