#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/state/client_quota.h"

namespace tessera::server {

struct ListenOptions {
  std::string address;       // unix:PATH or HOST:PORT; port 0: any free port
  std::string store;         // directory of the tokens
  std::string certs;         // directory of certificates (identity/authority.h); empty: none
  ClientQuotas quotas = {};  // of clients with certificates
  Log log = no_log;
};

/// The gRPC server: services, health and reflection on one address. A Unix socket is protected by
/// its directory; TCP by mutual TLS or, on loopback without certificates, by a token.
class FarmServer {
 public:
  /// Starts to listen. The coordinator must outlive the server.
  ///
  /// Errors: InvalidArgument, a remote address without certificates; Unavailable, the address
  /// cannot be bound; PermissionDenied, other users can enter the socket's directory, or the token
  /// cannot be written; those of contract::server_credentials().
  static absl::StatusOr<std::unique_ptr<FarmServer>> start(Coordinator& coordinator,
                                                           const ListenOptions& options);
  virtual ~FarmServer() = default;

  /// The address for clients, with the bound port.
  virtual const std::string& address() const = 0;
  /// Refuses new calls, ends running ones and waits for them.
  virtual void stop() = 0;
};

}  // namespace tessera::server
