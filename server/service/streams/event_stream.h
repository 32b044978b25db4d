#pragma once

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::server {

/// Returns a reactor that sends past and new events (JobService.WatchEvents); it deletes itself.
/// `caller`: the caller, or the status with which the stream ends at once.
grpc::ServerWriteReactor<v1::WatchEventsResponse>* watch_events(
    Coordinator& coordinator, const Access& access, IoPool& io,
    const v1::WatchEventsRequest& request, const absl::StatusOr<Caller>& caller);

}  // namespace tessera::server
