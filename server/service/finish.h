#pragma once

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "rpc/rpc_status.h"

namespace tessera::server {

/// Finishes a unary call at once with `status`.
inline grpc::ServerUnaryReactor* finish(grpc::CallbackServerContext* context,
                                        const absl::Status& status) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(contract::to_rpc(status));
  return reactor;
}

}  // namespace tessera::server
