#pragma once

#include "absl/status/status.h"
#include "server/coordinator.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// The reactor of a worker's Work stream; deletes itself. `allowed`: the status to end with at once
/// unless it is OK.
grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse>* work_stream(
    Coordinator& coordinator, grpc::CallbackServerContext& context, const absl::Status& allowed);

}  // namespace tessera::server
