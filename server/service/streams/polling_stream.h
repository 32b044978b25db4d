#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <mutex>

#include "absl/status/status.h"
#include "rpc/rpc_status.h"

namespace tessera::server {

/// Base of server streams that poll with a timer and send what has changed. Deletes itself when the
/// call is done.
template <typename Response>
class PollingStream : public grpc::ServerWriteReactor<Response> {
 public:
  // The names are those of gRPC.
  void OnCancel() final {  // NOLINT(readability-identifier-naming)
    const std::lock_guard lock(mutex_);
    is_cancelled_ = true;
    alarm_.Cancel();
  }

  void OnDone() final {  // NOLINT(readability-identifier-naming)
    { const std::lock_guard lock(mutex_); }
    delete this;
  }

 protected:
  /// Starts a write, calls wait() or calls finish(). Runs under the lock.
  virtual void poll() = 0;

  /// Finishes the call if the client has disconnected or `ok` is false, else polls. Requires the
  /// lock.
  void poll_unless_cancelled(bool ok) {
    if (!ok || is_cancelled_) {
      finish(absl::CancelledError("client disconnected"));
    } else {
      poll();
    }
  }

  /// Polls after `delay`. Requires the lock.
  void wait(std::chrono::milliseconds delay) {
    alarm_.Set(std::chrono::system_clock::now() + delay, [this](bool) {
      const std::lock_guard lock(mutex_);
      poll_unless_cancelled(true);
    });
  }

  void finish(const absl::Status& status) { this->Finish(contract::to_rpc(status)); }

  std::mutex mutex_;  // callbacks run on several threads

 private:
  bool is_cancelled_ = false;
  grpc::Alarm alarm_;
};

}  // namespace tessera::server
