#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "server/schedule/jobs/job_lifecycle.h"
#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/leasing/job_states.h"
#include "server/schedule/outcomes/results.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"
#include "server/schedule/trust/witnesses.h"

namespace tessera::server {

/// Failures and losses of units. They count by witness, so that one faulty worker fails no job.
class Failures {
 public:
  Failures(Tables& tables, Witnesses& witnesses, Quarantine& quarantine, JobStates& states,
           Dispatcher& dispatcher, JobLifecycle& lifecycle, Results& results)
      : workers_(tables.workers),
        jobs_(tables.jobs),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        leases_(tables.leases),
        identity_(tables.identity),
        policy_(tables.policy),
        witnesses_(witnesses),
        quarantine_(quarantine),
        states_(states),
        dispatcher_(dispatcher),
        lifecycle_(lifecycle),
        results_(results) {}

  /// The worker failed to render `tile` of `lease`. Ignored without a valid seal, and for a unit
  /// that the worker does not hold.
  void fail_unit(WorkerKey key, const Lease& lease, std::int32_t tile, Failure failure,
                 absl::StatusCode code, Time now);
  /// The worker was lost with a unit that it held.
  void lose_unit(Job& job, Worker& worker, const contract::Unit& unit, Time now);

 private:
  bool stops_job(const Job& job, const contract::Unit& unit) const;
  static void list_attempts(Job& job, const contract::Unit& unit);
  void pause_for_failures(Job& job, const contract::Unit& unit, const absl::Status& failure,
                          Time now);

  WorkerTable& workers_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  LeaseTable& leases_;
  const StoreIdentity& identity_;
  const SchedulePolicy& policy_;
  Witnesses& witnesses_;
  Quarantine& quarantine_;
  JobStates& states_;
  Dispatcher& dispatcher_;
  JobLifecycle& lifecycle_;
  Results& results_;
};

}  // namespace tessera::server
