#pragma once

#include "server/schedule/plan/job.h"
#include "server/schedule/queue/ready_jobs.h"
#include "server/schedule/tables/audit_table.h"
#include "server/schedule/tables/outgoing.h"
#include "server/schedule/workers/worker_counts.h"
#include "server/schedule/workers/worker_table.h"

namespace tessera::server {

/// Which workers hold which units, to render or to audit them. Each change is made in the job, in
/// the worker, in the use of limits and in the owner's share. Pure.
class LeaseTable {
 public:
  /// The tables must outlive this object.
  LeaseTable(WorkerTable& workers, WorkerCounts& counts, ReadyJobs& ready, Outgoing& outgoing,
             AuditTable& audits)
      : workers_(workers), counts_(counts), ready_(ready), outgoing_(outgoing), audits_(audits) {}

  static bool holds(const Worker& worker, const Job& job, const contract::Unit& unit) {
    return worker.leased_units.count({job.key, unit}) > 0;
  }
  /// Leases a unit. Requires a job with a plan; the caller calls ReadyJobs::refresh().
  void hold(Job& job, Worker& worker, const contract::Unit& unit, const Holder& holder);
  /// Notes that the plan has dropped a holder of the unit.
  void remove_hold(Job& job, const contract::Unit& unit, const Holder& holder);
  /// Takes the unit, or its audit, from the worker. Returns whether it had it.
  bool release(Job& job, Worker& worker, const contract::Unit& unit);

  /// Leases the audit of a unit.
  void hold_audit(Job& job, Worker& worker, const contract::Unit& unit, const Attempt& attempt);
  /// Takes the audit from the worker; it waits for another one. Returns whether it had it.
  bool release_audit(Job& job, Worker& worker, const contract::Unit& unit);
  /// Revokes the unit of an audit that is leased to a worker.
  void take_from_holder(Job& job, const contract::Unit& unit, const Audit& audit);
  /// Revokes the units of all audits of the job, which stay open.
  void suspend_audits(Job& job);
  /// Ends all audits of the job without an outcome.
  void drop_audits(Job& job);

 private:
  WorkerTable& workers_;
  WorkerCounts& counts_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  AuditTable& audits_;
};

}  // namespace tessera::server
