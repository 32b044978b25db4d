#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

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
  job_paused_by_failures,
  worker_set_aside,
  worker_brought_back,
  budget_warning,
  budget_used_up,
  job_queued,
  worker_draining,
};

struct Event {
  std::int64_t sequence = 0;  // set when it becomes visible
  std::int64_t time_us = 0;   // wall clock, when it happened
  EventKind kind = EventKind::log_line;
  std::string job_id, owner;  // owner of that job or budget; both empty if it concerns none
  std::string worker_id;
  std::string text;
};

/// Selects events.
struct EventQuery {
  std::int64_t after = 0;   // only after this sequence
  std::string job_id = {};  // this job's events; empty: of all jobs
  std::string owner = {};   // what this owner may see; empty: everything
};

/// Returns whether an owner may see the event: those of its jobs and budgets, and those of workers.
/// Budgets of projects are for admins.
inline bool is_visible_to(const Event& event, const std::string& owner) {
  if (owner.empty()) return true;
  const bool is_of_budget =
      event.kind == EventKind::budget_warning || event.kind == EventKind::budget_used_up;
  return event.owner.empty() ? !is_of_budget && event.job_id.empty() : event.owner == owner;
}

/// The newest events, durable. One thread at a time may call writing functions.
class EventStore {
 public:
  virtual ~EventStore() = default;

  /// Adds events in order of their sequences, which are above those added before, unless the
  /// transaction in which those were added failed. Durable on return. Drops the oldest ones beyond
  /// the maximum.
  virtual absl::Status add(const std::vector<Event>& events) = 0;
  /// Records that events after the last one added were lost; `before`: sequence of the next one.
  virtual absl::Status note_lost(std::int64_t before) = 0;

  /// Returns the oldest `limit` events that match, in order. Any thread.
  virtual absl::StatusOr<std::vector<Event>> read(const EventQuery& query,
                                                  std::size_t limit) const = 0;
  /// Returns the newest `limit` events, in order.
  virtual absl::StatusOr<std::vector<Event>> newest(std::size_t limit) const = 0;
  /// Sequence up to which events are missing; 0: none. Any thread.
  virtual std::int64_t last_dropped() const = 0;
};

}  // namespace tessera::server
