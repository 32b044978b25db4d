#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "rpc/rpc_status.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Base of server streams that poll with a timer, or when they are woken, and send what has
/// changed. Deletes itself when the call is done.
template <typename Response>
class PollingStream : public grpc::ServerWriteReactor<Response> {
 public:
  // The names are those of gRPC.
  void OnCancel() final {  // NOLINT(readability-identifier-naming)
    const MutexLock lock(mutex_);
    is_cancelled_ = true;
    alarm_.Cancel();
  }

  void OnDone() final {  // NOLINT(readability-identifier-naming)
    detach();
    { const MutexLock lock(mutex_); }
    delete this;
  }

  /// Polls soon if the stream waits, on a thread of gRPC.
  void wake() {
    const MutexLock lock(mutex_);
    alarm_.Cancel();
  }

 protected:
  /// Time after which a stream without news checks whether its caller is still allowed.
  static constexpr std::chrono::milliseconds kRecheck{1000};

  /// Starts a write, calls wait() or calls finish().
  virtual void poll() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;

  /// Called without locks before the stream is deleted: nothing may wake it afterwards.
  virtual void detach() {}

  /// Finishes the call if the client has disconnected or `ok` is false, else polls.
  void poll_unless_cancelled(bool ok) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!ok || is_cancelled_) {
      finish(absl::CancelledError("client disconnected"));
    } else {
      poll();
    }
  }

  /// Polls after `delay`.
  void wait(std::chrono::milliseconds delay) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    alarm_.Set(std::chrono::system_clock::now() + delay, [this](bool) {
      const MutexLock lock(mutex_);
      poll_unless_cancelled(true);
    });
  }

  void finish(const absl::Status& status) { this->Finish(contract::to_rpc(status)); }

  /// Callbacks run on several threads.
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kStream)
      ABSL_ACQUIRED_BEFORE(lock_order::kFarm){lock_order::kStream};

 private:
  bool is_cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  grpc::Alarm alarm_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
