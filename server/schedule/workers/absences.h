#pragma once

#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Workers of the roster that have not come back since the server's start. Until all of them have,
/// or the grace time is over, nothing is leased. Pure.
class Absences {
 public:
  Absences(const std::vector<std::string>& roster, Time grace_ends)
      : missing_(roster.begin(), roster.end()), grace_ends_(grace_ends) {}

  bool has_missing() const { return !missing_.empty(); }
  /// Returns whether leases wait for missing workers.
  bool is_grace(Time now) const { return has_missing() && now < grace_ends_; }
  /// Notes that a worker is here. Returns whether it was the last that was missing.
  bool arrive(const std::string& worker_id) {
    return missing_.erase(worker_id) > 0 && missing_.empty();
  }
  /// Extends the grace time, as this process was suspended so long.
  void extend(Duration late) { grace_ends_ += late; }
  /// Gives up missing workers at the end of the grace time, and returns their IDs.
  std::set<std::string> end(Time now) {
    return now < grace_ends_ ? std::set<std::string>{} : std::exchange(missing_, {});
  }

  /// Notes the time of a tick. Returns by how much it is later than a period after the last one.
  Duration note_tick(Time now, Duration period) {
    const Duration late = last_tick_ ? now - *last_tick_ - period : Duration(0);
    last_tick_ = now;
    return late;
  }
  /// Time of the last tick; absent before the first.
  const std::optional<Time>& last_tick() const { return last_tick_; }

 private:
  std::set<std::string> missing_;
  Time grace_ends_;
  std::optional<Time> last_tick_;
};

}  // namespace tessera::server
