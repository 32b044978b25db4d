#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator.h"

namespace tessera::server {

/// The farm's gRPC server: its services, health and reflection, on one local address.
class FarmServer {
 public:
  /// Starts to listen. `store_folder` is where the token is kept. The
  /// coordinator must outlive the server.
  ///
  /// Errors: InvalidArgument, the address is not on this machine; Unavailable, it cannot be bound;
  /// PermissionDenied, the socket's folder can be entered by others, or the token not be written.
  static absl::StatusOr<std::unique_ptr<FarmServer>> start(Coordinator& coordinator,
                                                           const std::string& address,
                                                           const std::string& store_folder);
  virtual ~FarmServer() = default;

  /// The address as clients use it, with the port that was bound.
  virtual const std::string& address() const = 0;
  /// Refuses new calls, ends those under way, waits for them.
  virtual void stop() = 0;
};

}  // namespace tessera::server
