#pragma once

#include <string>

#include "server/schedule/leasing/dependency_checks.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Changes of a job's state.
class JobStates {
 public:
  JobStates(Tables& tables, DependencyChecks& checks)
      : jobs_(tables.jobs),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        audit_table_(tables.audits),
        checks_(checks) {}

  /// Changes the state of a job, and what follows from it: its needs, its audits, its dependents.
  void set_state(Job& job, JobState state, const std::string& reason, Time now);

 private:
  JobTable& jobs_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  AuditTable& audit_table_;
  DependencyChecks& checks_;
};

}  // namespace tessera::server
