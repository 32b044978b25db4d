#pragma once

#include "absl/status/status.h"
#include "server/coordinator.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// A reactor that sends a job's state now and as it changes (JobService.WatchJob), and deletes
/// itself. `allowed`: the status to end with at once unless it is OK.
grpc::ServerWriteReactor<v1::WatchJobResponse>* watch_job(Coordinator& coordinator,
                                                          const v1::WatchJobRequest& request,
                                                          const absl::Status& allowed);

}  // namespace tessera::server
