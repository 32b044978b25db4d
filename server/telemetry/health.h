#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Health of the server, derived from signs of life of its threads, for probes of liveness and
/// readiness. Thread-safe and lock-free, so that it answers even if the farm's lock is stuck.
class Health {
 public:
  /// Time after which a thread that gives no sign counts as stuck.
  static constexpr std::chrono::seconds kTimerLimit{60}, kWriterLimit{30};
  /// Free space of the store's disk below which it counts as full.
  static constexpr std::int64_t kMinFreeBytes = std::int64_t{16} << 20;

  explicit Health(std::function<Time()> clock);

  /// The timer thread has held the farm's lock.
  void note_timer() { timer_ = now(); }
  /// The writer thread has finished what was posted before.
  void note_writer() { writer_ = now(); }
  /// Free space of the store's disk, and whether jobs are paused because it was full.
  void note_disk(std::int64_t free_bytes, bool has_paused_jobs) {
    free_bytes_ = free_bytes;
    has_paused_jobs_ = has_paused_jobs;
  }
  /// Calls are accepted from now on, or no longer.
  void set_accepting(bool is_accepting) { is_accepting_ = is_accepting; }

  /// Returns "" if the server is alive, else the reason why not: it must be restarted.
  std::string why_dead() const;
  /// Returns "" if the server is alive and can take work, else the reason why not: callers should
  /// wait. On a full disk they may still remove jobs.
  std::string why_unready() const;

 private:
  Duration::rep now() const { return clock_().time_since_epoch().count(); }
  double seconds_since(const std::atomic<Duration::rep>& sign) const;

  const std::function<Time()> clock_;
  std::atomic<Duration::rep> timer_, writer_;
  std::atomic<bool> is_accepting_ = false, has_paused_jobs_ = false;
  std::atomic<std::int64_t> free_bytes_ = kMinFreeBytes;
};

}  // namespace tessera::server
