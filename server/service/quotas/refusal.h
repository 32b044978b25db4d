#pragma once

#include <grpcpp/alarm.h>

#include <chrono>

#include "absl/status/status.h"
#include "rpc/rpc_status.h"
#include "server/service/quotas/client_limits.h"

namespace tessera::server {

/// Finishes a call that Access::admit() has refused: at once or, if the caller calls too often,
/// after a pause.
template <typename Reactor>
void refuse(Reactor& reactor, const absl::Status& status) {
  const std::chrono::milliseconds pause = pause_before_answer(status);
  if (pause.count() == 0) return reactor.Finish(contract::to_rpc(status));
  auto* const alarm = new grpc::Alarm;  // deleted by its own callback
  alarm->Set(std::chrono::system_clock::now() + pause, [alarm, &reactor, status](bool) {
    reactor.Finish(contract::to_rpc(status));
    delete alarm;
  });
}

}  // namespace tessera::server
