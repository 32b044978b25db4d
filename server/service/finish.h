#pragma once

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "server/service/quotas/refusal.h"

namespace tessera::server {

/// Finishes a unary call with `status`; if it comes from Access::admit(), as refuse() does.
inline grpc::ServerUnaryReactor* finish(grpc::CallbackServerContext* context,
                                        const absl::Status& status) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  refuse(*reactor, status);
  return reactor;
}

}  // namespace tessera::server
