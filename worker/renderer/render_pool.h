#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <thread>
#include <vector>

#include "worker/accel/scene_accel.h"

namespace tessera::agent {

/// The renderer's threads. Each takes one task (a unit) at a time; a thread that finds none helps
/// with the loops that running tasks have open. So units never share a thread while there are
/// enough of them, and their pixels are split while there are not.
class RenderPool {
 public:
  /// Requires thread_count >= 1.
  explicit RenderPool(int thread_count);
  /// Runs what is queued to the end, then joins.
  ~RenderPool();
  RenderPool(const RenderPool&) = delete;
  RenderPool& operator=(const RenderPool&) = delete;

  /// Queues a task; tasks start in order.
  void submit(std::function<void()> task);

  /// A loop for tasks and for threads outside the pool, which idle threads help with. The CPU time
  /// helpers spend is added to `helper_cpu_ns`, which must outlive the loop's calls.
  render::ParallelFor parallel_for(std::atomic<std::int64_t>& helper_cpu_ns);

 private:
  struct Loop {
    const std::int64_t count;
    const std::function<void(std::int64_t)>& body;
    std::atomic<std::int64_t>& helper_cpu_ns;
    std::atomic<std::int64_t> next = 0;
    int helpers = 0;  // guarded by mutex_
    bool unfinished() const { return next.load(std::memory_order_relaxed) < count; }
    void run();
  };

  void work();
  void help(std::unique_lock<std::mutex>& lock, Loop& loop);
  void run_loop(std::int64_t count, const std::function<void(std::int64_t)>& body,
                std::atomic<std::int64_t>& helper_cpu_ns);
  Loop* open_loop();

  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_, helper_left_;
  std::deque<std::function<void()>> tasks_;
  std::list<Loop*> loops_;
  int idle_ = 0;
  bool done_ = false;
  std::vector<std::thread> threads_;
};

/// CPU time the calling thread has used so far.
std::int64_t thread_cpu_ns();

}  // namespace tessera::agent
