#pragma once

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// A reference to a stream that may outlive it. Thread-safe.
template <typename Stream>
class StreamLink {
 public:
  explicit StreamLink(Stream& stream) : stream_(&stream) {}

  /// Ends the link; afterwards nothing calls the stream. Call before it is deleted, without locks.
  void detach() {
    const MutexLock lock(mutex_);
    stream_ = nullptr;
  }

  /// Calls `action` with the stream, unless the link has ended.
  template <typename Action>
  void with(const Action& action) {
    const MutexLock lock(mutex_);
    if (stream_ != nullptr) action(*stream_);
  }

 private:
  /// Held during calls of the stream, so that it is not destroyed.
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kConnection)
      ABSL_ACQUIRED_BEFORE(lock_order::kStream){lock_order::kConnection};
  Stream* stream_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
