#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/schedule/scheduler/scheduler.h"
#include "server/schedule/tables/policy.h"
#include "server/state/farm_state.h"

namespace tessera::server {

/// Checks that no unit waits longer than the schedule's rules allow, and that owners get their
/// shares. For farms with one pool, without tags, limits, dependencies and budgets.
///
/// Waits. A worker with credits never lacks units while a unit waits that it may render. An owner
/// to whom nothing was leased for SharePolicy::max_wait precedes all others except those that have
/// waited longer. Hence an owner waits at most max_wait, and then until each of the other owners
/// and itself has had one turn; a turn takes no longer than a worker needs for all units that it
/// may hold. The first two rules are checked for each lease, the sum without faults only.
///
/// Shares. While two owners with jobs of the same priority have many units waiting, an owner is
/// leased nothing by the order of shares while its use per weight exceeds the other's. Without that
/// decision it gets at most what the workers hold and bring back after a disconnection: so many
/// seconds may the difference of the use per weight change by, at most, on either side.
class FairnessChecks {
 public:
  /// Leases and windows that were checked, so that a test can see that there were some.
  struct Events {
    int leases = 0, overdue_leases = 0, share_windows = 0;
  };
  /// The workers of the farm.
  struct Workers {
    int count = 0;
    int credit_count = 0;        // of all workers
    Duration longest_turn = {};  // in which each renders all units that it may hold
  };
  FairnessChecks(SchedulePolicy policy, const Workers& workers, double unit_seconds);

  /// The server has started.
  void note_start(Time now);
  /// The server's timer was late: timeouts have been extended.
  void note_late_timer(Time now) { quiet_since_ = now; }
  /// No more faults take place.
  void note_calm(Time now) { calm_since_ = now; }
  /// A request to change a job of this owner has arrived, which may take its jobs out of the queue
  /// and put them back.
  void note_change(const std::string& owner) { changed_.insert(owner); }
  /// Leases were sent to a worker.
  void note_sent(const std::string& worker_id, const std::vector<Lease>& leases);
  /// Call after each step. Returns the first violation, "" if there is none.
  std::string check(const FarmView& farm, Time now);
  const Events& events() const { return events_; }

 private:
  struct Grant {
    std::string worker_id;
    Lease lease;
    bool operator<(const Grant& other) const { return lease.attempt < other.lease.attempt; }
  };
  /// An owner with units to lease.
  struct Waiting {
    std::optional<Time> since;  // last lease, else arrival; absent: not known
    std::set<JobKey> jobs;      // since the last step
  };
  struct Use {
    double committed = 0;                  // CPU seconds, scaled like positions of FairShare
    double leased = 0;                     // CPU seconds of units in flight
    std::optional<std::int32_t> priority;  // of jobs of which many units wait; absent: of none
  };
  /// A time in which two owners have many units waiting.
  struct Window {
    bool is_first_in_order = false, is_second_in_order = false;  // each was leased units in order
    std::optional<double> min, max, start;  // of the difference; of the sum at the start
  };
  using Pair = std::pair<std::string, std::string>;

  std::vector<Grant> take_grants(const FarmView& farm, bool& is_complete);
  void note_interruption(JobKey key, const Job& job);
  std::set<std::string> observe(const FarmView& farm, Time now);
  void check_grant(const FarmView& farm, const Grant& grant, Time now);
  void check_order(const FarmView& farm, const Grant& grant, const std::string& owner, Time now);
  void note_order(const Grant& grant, const std::string& owner, Time now);
  void update_waits(const std::set<std::string>& doubtful, Time now);
  void check_idle(const FarmView& farm, Time now);
  void check_windows(Time now);
  double weight(const std::string& owner) const;
  double scale(Time now) const;
  void violate(const std::string& what);

  const SchedulePolicy policy_;
  const Workers workers_;
  const double unit_seconds_;
  Time start_, quiet_since_;
  std::optional<Time> calm_since_;
  Attempt last_;  // newest lease that was checked
  std::vector<Grant> sent_;
  std::set<std::string> changed_;
  std::map<std::string, Waiting> waiting_;                      // by owner
  std::map<std::string, std::set<JobKey>> runnable_;            // at the end of this step, by owner
  std::map<std::string, std::optional<std::string>> last_job_;  // by worker; nullopt: not known
  std::set<std::pair<std::string, JobKey>> holds_;      // units of the job, now or a step before
  std::map<std::pair<std::string, JobKey>, int> idle_;  // steps
  std::map<JobKey, double> cpu_seconds_;                // counted so far
  std::map<JobKey, std::optional<Time>> running_since_;
  std::map<std::string, Use> use_;  // by owner
  std::map<Pair, Window> windows_;
  Events events_;
  std::string violation_;
};

}  // namespace tessera::server
