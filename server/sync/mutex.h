#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>

#include "absl/base/thread_annotations.h"
#include "server/sync/lock_order.h"

namespace tessera::server {

/// std::mutex with annotations for clang's -Wthread-safety, and a level of the lock order. Not
/// absl::Mutex: Debian's libabsl is built without TSan, which then reports correctly locked code as
/// racing.
class ABSL_LOCKABLE Mutex {
 public:
  Mutex() : Mutex(lock_order::kLeaf) {}
  explicit Mutex(const LockLevel& level) : order_(level) {}
  Mutex(const Mutex&) = delete;
  Mutex& operator=(const Mutex&) = delete;

  void lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() {
    order_.note_locking();
    mutex_.lock();
  }
  void unlock() ABSL_UNLOCK_FUNCTION() {
    order_.note_unlocking();
    mutex_.unlock();  // the next holder may destroy this at once, as the OnDone of streams does
  }
  /// Tells clang that the caller holds this lock, where it cannot see that. Does nothing.
  void assert_held() const ABSL_ASSERT_EXCLUSIVE_LOCK() {}

 private:
  friend class ConditionVariable;
  std::mutex mutex_;
  [[no_unique_address]] const LockOrderCheck order_;
};

/// A mutex that its holder may lock again. At run time its order is not checked.
class ABSL_LOCKABLE RecursiveMutex {
 public:
  void lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() { mutex_.lock(); }
  void unlock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock(); }

 private:
  std::recursive_mutex mutex_;
};

/// Holds a Mutex or RecursiveMutex for a scope.
template <typename M>
class ABSL_SCOPED_LOCKABLE MutexLock {
 public:
  explicit MutexLock(M& mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_.lock();
  }
  ~MutexLock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock(); }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

 private:
  M& mutex_;
};

/// Condition variable for Mutex. Wake-ups may be spurious; recheck the condition.
class ConditionVariable {
 public:
  void wait(Mutex& mutex) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    std::unique_lock<std::mutex> lock(mutex.mutex_, std::adopt_lock);
    condition_.wait(lock);
    lock.release();
  }
  void wait_for(Mutex& mutex, std::chrono::milliseconds timeout)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    std::unique_lock<std::mutex> lock(mutex.mutex_, std::adopt_lock);
    condition_.wait_until(lock, std::chrono::steady_clock::now() + timeout);
    lock.release();
  }
  void notify_one() { condition_.notify_one(); }
  void notify_all() { condition_.notify_all(); }

 private:
  std::condition_variable condition_;
};

}  // namespace tessera::server
