#pragma once

#include "absl/status/status.h"
#include "server/coordinator.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// The reactor of a worker's Deliver stream; deletes itself. `allowed`: the status to end with at
/// once unless it is OK.
grpc::ServerReadReactor<v1::DeliverRequest>* deliver_stream(Coordinator& coordinator,
                                                            const absl::Status& allowed);

}  // namespace tessera::server
