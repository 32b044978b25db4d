#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Limits the memory of delivered blocks: streams that would exceed it wait. Thread-safe; its lock
/// may be taken while the farm is locked.
class IngestBudget {
 public:
  explicit IngestBudget(std::int64_t limit_bytes) : limit_bytes_(limit_bytes) {}

  void take(std::int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Releases memory and calls the waiting streams if there is room now. Call without the farm's
  /// lock.
  void give_back(std::int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Takes `bytes` until the result is destroyed, which must not happen with the farm locked.
  std::shared_ptr<void> hold(std::int64_t bytes);
  /// Returns whether more blocks may be read now. If not, `resume` is called once there is room.
  bool has_room_or_call(std::function<void()> resume) ABSL_LOCKS_EXCLUDED(mutex_);
  /// Ends waiting: from now on there is always room.
  void stop() ABSL_LOCKS_EXCLUDED(mutex_);
  std::int64_t used_bytes() const ABSL_LOCKS_EXCLUDED(mutex_);
  std::int64_t limit_bytes() const { return limit_bytes_; }

 private:
  const std::int64_t limit_bytes_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::int64_t used_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<std::function<void()>> waiting_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace tessera::server
