#pragma once

#include "absl/status/status.h"
#include "server/coordinator.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// A reactor that sends a frame's file (JobService.FetchFrame), and deletes itself. `allowed`: the
/// status to end with at once unless it is OK.
grpc::ServerWriteReactor<v1::FetchFrameResponse>* send_frame(Coordinator& coordinator,
                                                             const v1::FetchFrameRequest& request,
                                                             const absl::Status& allowed);

}  // namespace tessera::server
