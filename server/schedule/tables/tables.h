#pragma once

#include <string>
#include <vector>

#include "server/schedule/queue/dependencies.h"
#include "server/schedule/queue/ready_jobs.h"
#include "server/schedule/tables/audit_table.h"
#include "server/schedule/tables/job_table.h"
#include "server/schedule/tables/lease_table.h"
#include "server/schedule/tables/outgoing.h"
#include "server/schedule/tables/policy.h"
#include "server/schedule/tables/stopped_accounts.h"
#include "server/schedule/workers/absences.h"
#include "server/schedule/workers/loaded_scenes.h"
#include "server/schedule/workers/placement.h"
#include "server/schedule/workers/worker_counts.h"
#include "server/schedule/workers/worker_table.h"

namespace tessera::server {

/// All tables of the schedule. The parts that decide share them; each names those that it uses.
/// Some tables refer to others, so this is neither copied nor moved.
struct Tables {
  Tables(StoreIdentity store, SchedulePolicy constants, const std::vector<std::string>& roster,
         Time start);
  Tables(const Tables&) = delete;
  Tables& operator=(const Tables&) = delete;

  const StoreIdentity identity;
  const SchedulePolicy policy;
  WorkerTable workers;
  WorkerCounts counts;
  LoadedScenes scenes;
  Placement placement;
  Absences absences;
  JobTable jobs;
  Dependencies dependencies;
  StoppedAccounts stopped;
  ReadyJobs ready;
  Outgoing outgoing;
  AuditTable audits;
  LeaseTable leases;
};

}  // namespace tessera::server
