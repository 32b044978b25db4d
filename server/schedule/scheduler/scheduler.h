#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/schedule/jobs/farm_limits.h"
#include "server/schedule/jobs/job_changes.h"
#include "server/schedule/jobs/job_lifecycle.h"
#include "server/schedule/jobs/wait_reasons.h"
#include "server/schedule/leasing/tail_balance.h"
#include "server/schedule/outcomes/audits.h"
#include "server/schedule/outcomes/failures.h"
#include "server/schedule/outcomes/results.h"
#include "server/schedule/presence/connections.h"
#include "server/schedule/presence/liveness.h"
#include "server/schedule/presence/worker_orders.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Decides which worker renders which unit (docs/explanation/fault-tolerance.md). Owns the tables,
/// and the parts that read and change them; callers name the part that they use.
///
/// A pure state machine without threads, locks, clock or files: callers pass `now`, serialise calls
/// and carry out the effects, so tests cover hours of timeouts in microseconds.
///
/// Callers may read the tables, and the jobs and workers in them; the parts change what other
/// tables refer to.
class Scheduler {
 public:
  /// Leases nothing until every worker of the roster is connected, or until policy.restart_grace
  /// after `start`.
  Scheduler(StoreIdentity identity, SchedulePolicy policy, const std::vector<std::string>& roster,
            Time start);

  JobTable& jobs() { return tables_.jobs; }
  const JobTable& jobs() const { return tables_.jobs; }
  WorkerTable& workers() { return tables_.workers; }
  const WorkerTable& workers() const { return tables_.workers; }

  JobChanges& changes() { return changes_; }
  JobLifecycle& lifecycle() { return lifecycle_; }
  DependencyChecks& dependencies() { return dependencies_; }
  FarmLimits& limits() { return limits_; }
  const FarmLimits& limits() const { return limits_; }
  const WaitReasons& waiting() const { return waiting_; }
  Dispatcher& dispatcher() { return dispatcher_; }

  Connections& connections() { return connections_; }
  WorkerOrders& orders() { return orders_; }
  const WorkerOrders& orders() const { return orders_; }
  Quarantine& quarantine() { return quarantine_; }
  const Quarantine& quarantine() const { return quarantine_; }

  Results& results() { return results_; }
  Failures& failures() { return failures_; }
  Audits& audits() { return audits_; }

  /// Call about every `period`: expires silent workers, ends the restart grace, balances the last
  /// units.
  void tick(Time now, Duration period);
  /// Returns the actions decided since the last call.
  Effects take_effects();
  /// Counts everything again and compares it with the indexes, for tests. Errors: Internal, the
  /// first difference.
  absl::Status verify() const;
  /// The newest lease of this start; its counter is the number of leases granted.
  Attempt last_attempt() const { return grants_.last_attempt(); }
  /// Number of workers and jobs visited so far. Tests of cost count these steps instead of time.
  std::int64_t step_count() const { return tables_.counts.step_count(); }

 private:
  // In the order in which they use each other.
  Tables tables_;
  Witnesses witnesses_;
  Quarantine quarantine_;
  DependencyChecks dependencies_;
  JobStates states_;
  LeaseGrants grants_;
  JobChoice choice_;
  Dispatcher dispatcher_;
  TailBalance tail_balance_;
  JobLifecycle lifecycle_;
  JobChanges changes_;
  FarmLimits limits_;
  WaitReasons waiting_;
  Results results_;
  Failures failures_;
  Audits audits_;
  Connections connections_;
  Liveness liveness_;
  WorkerOrders orders_;
};

}  // namespace tessera::server
