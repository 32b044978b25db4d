#pragma once

#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Threads that read and write files for streams, so that a slow disk does not hold up gRPC's
/// threads and with them heartbeats and acknowledgements.
///
/// A stream posts one task at a time, and the number of streams is limited, so the queue is too.
class IoPool {
 public:
  enum class Priority { normal, low };
  /// With a low priority, its threads get a tenth of a core while others need all of it.
  explicit IoPool(int thread_count, Priority priority = Priority::normal);
  /// Carries out what has been posted, then ends the threads.
  ~IoPool();
  IoPool(const IoPool&) = delete;
  IoPool& operator=(const IoPool&) = delete;

  void post(std::function<void()> task);

 private:
  void run();

  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  ConditionVariable wake_;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace tessera::server
