#pragma once

#include "absl/status/status.h"
#include "server/schedule/leasing/dependency_checks.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"

namespace tessera::server {

/// Compares the indexes of the schedule with what they are made from, for tests.
class ScheduleCheck {
 public:
  ScheduleCheck(const Tables& tables, const Quarantine& quarantine, const DependencyChecks& checks)
      : workers_(tables.workers),
        counts_(tables.counts),
        jobs_(tables.jobs),
        stopped_(tables.stopped),
        ready_(tables.ready),
        audit_table_(tables.audits),
        policy_(tables.policy),
        quarantine_(quarantine),
        checks_(checks) {}

  /// Counts everything again and compares it with the indexes, for tests. Errors: Internal, the
  /// first difference.
  absl::Status verify() const;

 private:
  absl::Status verify_job(const Job& job) const;
  absl::Status verify_worker(const Worker& worker) const;
  absl::Status verify_limits() const;

  const WorkerTable& workers_;
  const WorkerCounts& counts_;
  const JobTable& jobs_;
  const StoppedAccounts& stopped_;
  const ReadyJobs& ready_;
  const AuditTable& audit_table_;
  const SchedulePolicy& policy_;
  const Quarantine& quarantine_;
  const DependencyChecks& checks_;
};

}  // namespace tessera::server
