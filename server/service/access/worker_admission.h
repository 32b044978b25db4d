#pragma once

#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/identity/join_tokens.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"

namespace tessera::server {

/// Admits workers. On a Unix socket and with the store's token, all; with certificates, those that
/// send a valid join token or, when they reconnect, the session key that they got on joining.
class WorkerAdmission {
 public:
  /// `tokens` is absent if no tokens are required. The coordinator must outlive this.
  WorkerAdmission(Coordinator& coordinator, std::optional<JoinTokens> tokens)
      : coordinator_(coordinator), tokens_(std::move(tokens)) {}

  /// Calls `done`, on this or another thread, with the worker's session key (empty if it needs
  /// none) once the join is journaled.
  ///
  /// Errors: Unauthenticated, the token is missing, unknown, revoked or expired; PermissionDenied,
  /// the token is used up, or the worker ID belongs to another certificate.
  void admit(const Caller& caller, const std::string& worker_id, const std::string& token,
             const std::function<void(absl::StatusOr<std::string>)>& done);

 private:
  Coordinator& coordinator_;
  const std::optional<JoinTokens> tokens_;
  IoPool io_{1};  // reads tokens
};

}  // namespace tessera::server
