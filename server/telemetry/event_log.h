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

/// What may happen; the numbers are those of v1.Event.Kind.
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
};

struct Event {
  std::int64_t sequence = 0;  // set by the log
  std::int64_t time_us = 0;   // wall clock, set by the log
  EventKind kind = EventKind::log_line;
  std::string job_id, owner;  // of that job; empty: of no job
  std::string worker_id;
  std::string text;
};

/// The first `most` bytes of UTF-8 text, less what would be a part of a letter.
std::string cut_text(std::string text, std::size_t most);

/// What happened lately, for people who ask. In memory and bounded: the newest kMaxEvents events,
/// and apart from them (so that talk pushes out no events) the newest kMaxLines lines of workers'
/// logs, kMaxLinesOfJob of one job, kMaxTextBytes each. Thread-safe.
class EventLog {
 public:
  static constexpr std::size_t kMaxEvents = 10'000;
  static constexpr std::size_t kMaxLines = 50'000, kMaxLinesOfJob = 2'000;
  static constexpr std::size_t kMaxTextBytes = 1024;

  /// Sequences grow over restarts if `boot_count` does. `wall_us`: µs since 1970.
  EventLog(std::int64_t boot_count, std::function<std::int64_t()> wall_us);

  void add(Event event);

  /// Which events to read.
  struct Query {
    std::int64_t after = 0;  // newer than this sequence
    std::string job_id;      // of this job, with its lines; empty: events of all, no lines
    std::string owner;       // of this owner's jobs, and of no job; empty: everybody's
  };
  /// The oldest `most` that fit, in order.
  std::vector<Event> read(const Query& query, std::size_t most) const;
  /// The sequence of the newest, whether or not it is still kept; older logs' are smaller.
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
