#pragma once

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// Returns the reactor of a worker's Deliver stream; it deletes itself. `caller`: the caller, or
/// the status with which the stream ends at once.
grpc::ServerReadReactor<v1::DeliverRequest>* deliver_stream(Coordinator& coordinator,
                                                            const absl::StatusOr<Caller>& caller);

}  // namespace tessera::server
