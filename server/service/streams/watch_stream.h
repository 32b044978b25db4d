#pragma once

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// Returns a reactor that sends a job's state now and when it changes (JobService.WatchJob); it
/// deletes itself. `caller`: the caller, or the status with which the stream ends at once.
grpc::ServerWriteReactor<v1::WatchJobResponse>* watch_job(Coordinator& coordinator,
                                                          const Access& access,
                                                          const v1::WatchJobRequest& request,
                                                          const absl::StatusOr<Caller>& caller);

}  // namespace tessera::server
