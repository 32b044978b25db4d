#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/client_limits.h"

namespace tessera::server {

struct ListenOptions {
  std::string address;     // unix:PATH or HOST:PORT; port 0: any
  std::string store;       // folder where tokens are kept
  std::string certs;       // folder of certificates (identity/authority.h); empty: none
  ClientRates rates = {};  // with certificates: what each client may do
};

/// The farm's gRPC server: its services, health and reflection, on one address. A Unix socket is
/// guarded by its folder; TCP by mutual TLS, or, on loopback without certificates, by a token.
class FarmServer {
 public:
  /// Starts to listen. The coordinator must outlive the server.
  ///
  /// Errors: InvalidArgument, the address is not on this machine and there are no certificates;
  /// Unavailable, it cannot be bound; PermissionDenied, the socket's folder can be entered by
  /// others, or the token not be written; those of contract::server_credentials().
  static absl::StatusOr<std::unique_ptr<FarmServer>> start(Coordinator& coordinator,
                                                           const ListenOptions& options);
  virtual ~FarmServer() = default;

  /// The address as clients use it, with the port that was bound.
  virtual const std::string& address() const = 0;
  /// Refuses new calls, ends those under way, waits for them.
  virtual void stop() = 0;
};

}  // namespace tessera::server
