#pragma once

#include <cstdint>

#include "server/schedule/leasing/job_states.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Writes leases: seals them, notes who holds the units, and puts them into outboxes.
class LeaseGrants {
 public:
  LeaseGrants(Tables& tables, JobStates& states)
      : counts_(tables.counts),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        leases_(tables.leases),
        identity_(tables.identity),
        states_(states) {}

  /// Leases the audit of a unit that waits for a worker.
  void lease_audit(Job& job, contract::Unit unit, Worker& worker);
  /// The latest attempt.
  Attempt last_attempt() const { return {identity_.boot, last_attempt_}; }
  /// Leases a run of units to the worker.
  void lease(Job& job, Worker& worker, const Run& run, Time now);

 private:
  Lease make_lease(const Job& job, const Worker& worker, const Run& run);
  /// Has the job described to a worker that never held a unit of it.
  void introduce(const Job& job, Worker& worker);
  void send_lease(Worker& worker, const Lease& lease);

  WorkerCounts& counts_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  LeaseTable& leases_;
  const StoreIdentity& identity_;
  JobStates& states_;
  std::int64_t last_attempt_ = 0;
};

}  // namespace tessera::server
