#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Tasks for a pool of threads. Tasks of one key run in order and never at the same time; tasks of
/// different keys may, oldest first. A single thread runs all tasks in the order of their posting.
///
/// Tasks that need much memory are large. They are limited in number, so that threads are left for
/// the others, and in memory; one that exceeds the limit runs when no other large task does. They
/// start in order, so none waits for ever.
///
/// Thread-safe; tasks run without its lock, which may be taken while the farm is locked.
template <typename Key>
class StrandQueue {
 public:
  using Task = std::function<void()>;
  /// Limits of the large tasks that run at the same time.
  struct Limits {
    int count = 1;
    std::int64_t bytes = 0;
  };

  explicit StrandQueue(Limits limits) : limits_(limits) {}

  /// Posts a task of `key`, a large one if `bytes` is not 0.
  void post(const Key& key, Task task, std::int64_t bytes = 0) {
    const MutexLock lock(mutex_);
    Strand& strand = strands_[key];
    strand.waiting.push_back({std::move(task), bytes, next_number_++});
    ++waiting_count_;
    if (strand.is_running || strand.waiting.size() > 1) return;
    make_ready(key, strand);
    wakeup_.notify_one();
  }
  /// Called by a task of `key`: posts a task that runs after it and before those of the key that
  /// wait already.
  void post_next(const Key& key, Task task, std::int64_t bytes = 0) {
    const MutexLock lock(mutex_);
    Strand& strand = strands_.at(key);
    strand.next.push_back({std::move(task), bytes, strand.number});
    ++waiting_count_;
  }

  /// Body of each thread: runs tasks, after waiting for one if `wait`; without `wait` only those
  /// posted before this call. Returns whether it did anything.
  bool run(bool wait) {
    std::int64_t end = std::numeric_limits<std::int64_t>::max();
    {
      const MutexLock lock(mutex_);
      while (wait && !stopping_ && first_ready() == nullptr) wakeup_.wait(mutex_);
      if (!wait) end = next_number_;
    }
    bool has_run = false;
    while (run_first(wait, end)) has_run = true;
    return has_run;
  }
  /// Ends waiting rounds after their current tasks; rounds without waiting still run what is
  /// posted.
  void stop() {
    const MutexLock lock(mutex_);
    stopping_ = true;
    wakeup_.notify_all();
  }
  /// Number of waiting tasks.
  std::size_t size() const {
    const MutexLock lock(mutex_);
    return waiting_count_;
  }
  /// Returns the keys from `first` to `last` with a task that waits or runs.
  std::vector<Key> keys(const Key& first, const Key& last) const {
    const MutexLock lock(mutex_);
    std::vector<Key> keys;
    for (auto it = strands_.lower_bound(first); it != strands_.end() && !(last < it->first); ++it) {
      keys.push_back(it->first);
    }
    return keys;
  }

 private:
  struct Item {
    Task task;
    std::int64_t bytes;
    std::int64_t number;  // order of posting
  };
  struct Strand {
    std::deque<Item> waiting;
    std::vector<Item> next;   // posted by the running task with post_next()
    std::int64_t number = 0;  // of the running task
    bool is_running = false;
  };
  using Ready = std::map<std::int64_t, Key>;  // by number of the strand's first task

  void make_ready(const Key& key, const Strand& strand) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const Item& first = strand.waiting.front();
    (first.bytes > 0 ? large_ : small_).emplace(first.number, key);
  }
  bool may_start_large() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (large_.empty() || large_count_ >= limits_.count) return false;
    const Item& first = strands_.at(large_.begin()->second).waiting.front();
    return large_count_ == 0 || large_bytes_ + first.bytes <= limits_.bytes;
  }
  /// Returns the table whose first task is the oldest that may start; nullptr if there is none.
  Ready* first_ready() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!may_start_large()) return small_.empty() ? nullptr : &small_;
    const bool is_small_first = !small_.empty() && small_.begin()->first < large_.begin()->first;
    return is_small_first ? &small_ : &large_;
  }

  /// Runs the oldest task that may start if its number is below `end`. Returns whether there was
  /// one.
  bool run_first(bool wait, std::int64_t end) {
    Key key;
    Item item;
    {
      const MutexLock lock(mutex_);
      Ready* const ready = first_ready();
      if (ready == nullptr || ready->begin()->first >= end || (wait && stopping_)) return false;
      key = ready->extract(ready->begin()).mapped();
      Strand& strand = strands_.at(key);
      item = std::move(strand.waiting.front());
      strand.waiting.pop_front();
      strand.number = item.number;
      strand.is_running = true;
      --waiting_count_;
      count_large(item, 1);
    }
    item.task();
    item.task = nullptr;  // destroyed before the next task of the key starts
    const MutexLock lock(mutex_);
    count_large(item, -1);
    end_task(key);
    // This thread takes one of the tasks that may start now, unless its round ends.
    if (!wait || small_.size() + large_.size() > 1) wakeup_.notify_all();
    return true;
  }
  void count_large(const Item& item, int sign) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (item.bytes == 0) return;
    large_count_ += sign;
    large_bytes_ += sign * item.bytes;
  }
  void end_task(const Key& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Strand& strand = strands_.at(key);
    strand.is_running = false;
    strand.waiting.insert(strand.waiting.begin(), std::move_iterator(strand.next.begin()),
                          std::move_iterator(strand.next.end()));
    strand.next.clear();
    if (strand.waiting.empty()) {
      strands_.erase(key);
    } else {
      make_ready(key, strand);
    }
  }

  const Limits limits_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  ConditionVariable wakeup_;
  std::map<Key, Strand> strands_ ABSL_GUARDED_BY(mutex_);  // those with a task
  Ready small_ ABSL_GUARDED_BY(mutex_), large_ ABSL_GUARDED_BY(mutex_);
  std::int64_t next_number_ ABSL_GUARDED_BY(mutex_) = 0;
  std::size_t waiting_count_ ABSL_GUARDED_BY(mutex_) = 0;
  int large_count_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t large_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace tessera::server
