#pragma once

#include <cstdint>
#include <vector>

#include "server/schedule/leasing/job_choice.h"
#include "server/schedule/leasing/lease_grants.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Distributes the last units of a job again, when none is waiting and workers are idle.
class TailBalance {
 public:
  TailBalance(Tables& tables, LeaseGrants& grants, JobChoice& choice)
      : workers_(tables.workers),
        counts_(tables.counts),
        absences_(tables.absences),
        jobs_(tables.jobs),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        grants_(grants),
        choice_(choice) {}

  /// Has idle workers help with the last units of jobs: copies slow ones, takes back those that are
  /// not started.
  void balance_tail(Time now);

 private:
  std::vector<Worker*> idle_workers();
  void copy_slow_units(std::vector<Worker*>& idle, Time now);
  void steal_unstarted(std::int32_t wanted);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  Absences& absences_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  LeaseGrants& grants_;
  JobChoice& choice_;
};

}  // namespace tessera::server
