#pragma once

#include <chrono>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "server/service/access/worker_admission.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// Parts of the server that a Work stream uses; all outlive it.
struct WorkStreamContext {
  Coordinator& coordinator;
  const Access& access;
  WorkerAdmission& admission;
  std::chrono::milliseconds hello_timeout;  // for the first message
};

/// Returns the reactor of a worker's Work stream; it deletes itself. `caller`: the caller, or the
/// status with which the stream ends at once.
grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse>* work_stream(
    const WorkStreamContext& services, grpc::CallbackServerContext& context,
    const absl::StatusOr<Caller>& caller);

}  // namespace tessera::server
