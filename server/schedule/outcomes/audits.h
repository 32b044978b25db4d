#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "server/schedule/jobs/job_lifecycle.h"
#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"
#include "server/schedule/trust/witnesses.h"

namespace tessera::server {

/// Has other workers render some units again, and quarantines workers whose results were wrong.
class Audits {
 public:
  Audits(Tables& tables, Witnesses& witnesses, Quarantine& quarantine, Dispatcher& dispatcher,
         JobLifecycle& lifecycle)
      : workers_(tables.workers),
        counts_(tables.counts),
        absences_(tables.absences),
        jobs_(tables.jobs),
        outgoing_(tables.outgoing),
        audit_table_(tables.audits),
        leases_(tables.leases),
        identity_(tables.identity),
        policy_(tables.policy),
        witnesses_(witnesses),
        quarantine_(quarantine),
        dispatcher_(dispatcher),
        lifecycle_(lifecycle) {}

  /// A worker's result of a unit.
  struct Result {
    std::string worker_id;
    contract::Digest digest;
  };
  /// Returns whether a unit that this worker delivered must be audited: there is another worker, or
  /// one may be back soon after a restart, and the unit is drawn or the worker's first since then.
  bool wants_audit(const Job& job, const contract::Unit& unit, const std::string& worker_id,
                   Time now);
  /// Returns, once for a job, the workers that share a certificate with this one if there are any,
  /// and all workers of the job do: none of its units can be audited. Else returns nothing.
  std::vector<std::string> note_unaudited(Job& job, const std::string& worker_id, Time now);
  /// Has others render a committed unit again. Idempotent.
  void open_audit(Job& job, const contract::Unit& unit, const std::string& worker_id,
                  const contract::Digest& committed);
  /// Returns whether the frame waits for audits.
  bool has_audits(const Job& job, std::int32_t frame) const;
  /// Takes a further result of a committed unit under `lease`. Returns whether it answers an audit.
  /// A result that differs starts an audit, unless audits are off (audit_fraction 0).
  bool answer_audit(Job& job, const contract::Unit& unit, const Lease& lease, const Result& result,
                    const Result& committed, Time now);
  /// Drops audits without a worker to ask; a dispute that cannot be settled fails its job.
  void fail_unresolvable_audits(Time now);

 private:
  void end_audit(Job& job, const contract::Unit& unit, Time now);
  void quarantine(const std::string& worker_id);
  std::vector<AuditQueue::Key> unresolvable(const std::set<AuditQueue::Key>& group, Time now);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  Absences& absences_;
  JobTable& jobs_;
  Outgoing& outgoing_;
  AuditTable& audit_table_;
  LeaseTable& leases_;
  const StoreIdentity& identity_;
  const SchedulePolicy& policy_;
  Witnesses& witnesses_;
  Quarantine& quarantine_;
  Dispatcher& dispatcher_;
  JobLifecycle& lifecycle_;
};

}  // namespace tessera::server
