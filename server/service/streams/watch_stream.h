#pragma once

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// A reactor that sends a job's state now and as it changes (JobService.WatchJob), and deletes
/// itself. `caller`: who, or the status to end with at once.
grpc::ServerWriteReactor<v1::WatchJobResponse>* watch_job(Coordinator& coordinator,
                                                          const Access& access,
                                                          const v1::WatchJobRequest& request,
                                                          const absl::StatusOr<Caller>& caller);

}  // namespace tessera::server
