#pragma once

#include <grpcpp/server_context.h>

#include <string>

#include "absl/status/status.h"

namespace tessera::server {

/// Who may call: on a Unix socket everybody who can open it (its folder is private), on loopback
/// TCP whoever sends the store's token.
class Access {
 public:
  /// `token`: empty for a Unix socket.
  explicit Access(std::string token) : token_(std::move(token)) {}

  /// Errors: Unauthenticated, no token or a wrong one. Constant time in the token.
  absl::Status check(const grpc::CallbackServerContext& context) const;

 private:
  const std::string token_;
};

}  // namespace tessera::server
