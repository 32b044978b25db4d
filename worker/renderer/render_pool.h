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

/// Thread pool of the renderer. Each thread runs one task (a unit) at a time; a thread without a
/// task helps with the parallel loops of running tasks. Thus units run on one thread each while
/// there are enough of them, and their pixels are divided among threads otherwise.
class RenderPool {
 public:
  /// Requires thread_count >= 1.
  explicit RenderPool(int thread_count);
  /// Runs all queued tasks, then joins the threads.
  ~RenderPool();
  RenderPool(const RenderPool&) = delete;
  RenderPool& operator=(const RenderPool&) = delete;

  /// Queues a task; tasks start in order.
  void submit(std::function<void()> task);

  /// Returns a parallel loop, callable from tasks and from other threads, with which idle threads
  /// help. Adds the helpers' CPU time to `helper_cpu_ns`, which must outlive the loop's calls.
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

/// Returns the CPU time of the calling thread, ns.
std::int64_t thread_cpu_ns();

}  // namespace tessera::agent
