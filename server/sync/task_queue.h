#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Tasks for one thread, carried out in order and without a lock. Thread-safe; its lock may be
/// taken while the farm is locked.
class TaskQueue {
 public:
  using Task = std::function<void()>;

  void post(Task task) {
    const MutexLock lock(mutex_);
    tasks_.push_back(std::move(task));
    wakeup_.notify_all();
  }
  /// Body of the thread: runs what is queued, after waiting for something if `wait`. Returns
  /// whether it did anything.
  bool run(bool wait) {
    std::deque<Task> tasks;
    {
      const MutexLock lock(mutex_);
      while (wait && !stopping_ && tasks_.empty()) wakeup_.wait(mutex_);
      tasks.swap(tasks_);
    }
    if (tasks.empty()) return false;
    for (; !tasks.empty(); tasks.pop_front()) tasks.front()();  // each is destroyed when it has run
    return true;
  }
  /// Ends waiting rounds; further rounds without waiting still run what is queued.
  void stop() {
    const MutexLock lock(mutex_);
    stopping_ = true;
    wakeup_.notify_all();
  }
  std::size_t size() const {
    const MutexLock lock(mutex_);
    return tasks_.size();
  }

 private:
  mutable Mutex mutex_;
  ConditionVariable wakeup_;
  std::deque<Task> tasks_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace tessera::server
