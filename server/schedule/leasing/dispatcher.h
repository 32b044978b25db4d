#pragma once

#include <cstdint>
#include <vector>

#include "server/schedule/leasing/job_choice.h"
#include "server/schedule/leasing/lease_grants.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/witnesses.h"

namespace tessera::server {

/// Leases waiting units and audits to workers with credits.
class Dispatcher {
 public:
  Dispatcher(Tables& tables, Witnesses& witnesses, LeaseGrants& grants, JobChoice& choice)
      : workers_(tables.workers),
        counts_(tables.counts),
        absences_(tables.absences),
        jobs_(tables.jobs),
        ready_(tables.ready),
        audit_table_(tables.audits),
        witnesses_(witnesses),
        grants_(grants),
        choice_(choice) {}

  /// Leases waiting units to the worker while it has credits.
  void dispatch(Worker& worker, Time now);
  /// Leases waiting units to workers with credits. Call after jobs were added or changed.
  void dispatch_all(Time now);

 private:
  std::int32_t run_length(const Job& job, const Worker& worker) const;
  bool lease_run(Job& job, Worker& worker, Time now);
  bool has_work() const;
  bool dispatch_one(Worker& worker, Time now);
  std::vector<Worker*> workers_by_load_and_scene();
  bool lease_audit(Worker& worker);
  bool lease_audit_of(const AuditQueue::Groups& groups, Worker& worker);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  Absences& absences_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  AuditTable& audit_table_;
  Witnesses& witnesses_;
  LeaseGrants& grants_;
  JobChoice& choice_;
};

}  // namespace tessera::server
