#pragma once

#include <memory>
#include <string>

#include "server/schedule/leasing/dependency_checks.h"
#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Adds jobs and changes their settings.
class JobChanges {
 public:
  JobChanges(Tables& tables, DependencyChecks& checks, Dispatcher& dispatcher)
      : workers_(tables.workers),
        jobs_(tables.jobs),
        dependencies_(tables.dependencies),
        stopped_(tables.stopped),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        audit_table_(tables.audits),
        leases_(tables.leases),
        checks_(checks),
        dispatcher_(dispatcher) {}

  /// Adds a job from the journal. Requires a new key and ID.
  Job& add_job(JobKey key, std::shared_ptr<const JobSpec> spec, JobState state);
  /// Changes to a longer schedule; `spec` has the new settings. The caller restores finished
  /// frames.
  void extend(Job& job, std::shared_ptr<const JobSpec> spec);
  /// Changes priority, requirements, limits, dependencies and blocked workers; `spec` has the new
  /// ones and the same settings. Units already leased are rendered, but for those that a blocked
  /// worker has not started.
  void change(Job& job, std::shared_ptr<const JobSpec> spec, Time now);
  /// Leases units of a job only to workers that are known to have its scene, because the store has
  /// lost the file `uri` of it; others would return the units at once.
  void lose_asset(Job& job, const std::string& uri);
  /// Leases them to all workers again. Does nothing for a job that lacks no file.
  void find_asset(Job& job, Time now);
  /// Sets the upper bound of the job's needs.
  void set_demand(Job& job, double store_bytes, double samples);

 private:
  WorkerTable& workers_;
  JobTable& jobs_;
  Dependencies& dependencies_;
  StoppedAccounts& stopped_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  AuditTable& audit_table_;
  LeaseTable& leases_;
  DependencyChecks& checks_;
  Dispatcher& dispatcher_;
};

}  // namespace tessera::server
