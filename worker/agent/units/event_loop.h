#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>

namespace tessera::agent {

/// Runs events posted by other threads (gRPC, the renderer's reader, downloads) on one thread.
class EventLoop {
 public:
  /// Queues an event. Thread-safe.
  void post(std::function<void()> event) {
    const std::lock_guard lock(mutex_);
    events_.push_back(std::move(event));
    arrived_.notify_one();
  }

  /// Waits for an event until `deadline`, then runs all queued events. One thread only.
  void run_until(std::chrono::steady_clock::time_point deadline) {
    std::deque<std::function<void()>> events;
    {
      std::unique_lock lock(mutex_);
      arrived_.wait_until(lock, deadline, [this] { return !events_.empty(); });
      events.swap(events_);
    }
    for (const auto& event : events) event();
  }

 private:
  std::mutex mutex_;  // guards what follows
  std::condition_variable arrived_;
  std::deque<std::function<void()>> events_;
};

}  // namespace tessera::agent
