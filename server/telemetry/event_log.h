#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace tessera::server {

/// Kind of an event; numbers as in v1.Event.Kind.
enum class EventKind : std::int32_t {
  job_submitted = 1,
  job_running,
  job_paused,
  job_done,
  job_failed,
  job_cancelled,
  job_removed,
  frame_finished,
  unit_failed,
  worker_joined,
  worker_lost,
  worker_quarantined,
  worker_drained,
  worker_banned,
  worker_allowed,
  log_line,
  job_changed,
  worker_moved,
};

struct Event {
  std::int64_t sequence = 0;  // set by the log
  std::int64_t time_us = 0;   // wall clock, set by the log
  EventKind kind = EventKind::log_line;
  std::string job_id, owner;  // owner of that job; both empty if the event concerns no job
  std::string worker_id;
  std::string text;
};

/// Returns the first `max_bytes` bytes of UTF-8 text, without a partial character at the end.
std::string cut_text(std::string text, std::size_t max_bytes);

/// Recent events and log lines. In memory and bounded: the newest kMaxEvents events, and
/// separately, so that log lines displace no events, the newest kMaxLines lines of workers' logs,
/// kMaxLinesOfJob per job, kMaxTextBytes each. Thread-safe.
class EventLog {
 public:
  static constexpr std::size_t kMaxEvents = 10'000;
  static constexpr std::size_t kMaxLines = 50'000, kMaxLinesOfJob = 2'000;
  static constexpr std::size_t kMaxTextBytes = 1024;

  /// Sequences increase across restarts if `boot_count` does. `wall_us`: µs since 1970.
  EventLog(std::int64_t boot_count, std::function<std::int64_t()> wall_us);

  void add(Event event);

  /// Selects events.
  struct Query {
    std::int64_t after = 0;  // only after this sequence
    std::string job_id;      // this job's events and lines; empty: events of all jobs, no lines
    std::string owner;       // this owner's jobs, and events without a job; empty: everybody's
  };
  /// Returns the oldest `limit` events that match, in order.
  std::vector<Event> read(const Query& query, std::size_t limit) const;
  /// Sequence of the newest event, even if it is no longer kept.
  std::int64_t newest() const;

 private:
  const std::function<std::int64_t()> wall_us_;
  mutable std::mutex mutex_;  // guards what follows
  std::int64_t last_sequence_;
  std::deque<Event> events_;
  std::map<std::string, std::deque<Event>> lines_;  // by job
  std::size_t line_count_ = 0;
};

}  // namespace tessera::server
