#pragma once

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// A reactor that sends what happened, and what happens (JobService.WatchEvents), and deletes
/// itself. `caller`: who, or the status to end with at once.
grpc::ServerWriteReactor<v1::WatchEventsResponse>* watch_events(
    Coordinator& coordinator, const Access& access, const v1::WatchEventsRequest& request,
    const absl::StatusOr<Caller>& caller);

}  // namespace tessera::server
