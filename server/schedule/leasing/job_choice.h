#pragma once

#include <functional>
#include <set>

#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/witnesses.h"

namespace tessera::server {

/// Chooses the job of which a worker is leased units next, by the order of the queue, the scenes
/// that the worker has loaded, limits and blocked workers.
class JobChoice {
 public:
  JobChoice(Tables& tables, Witnesses& witnesses)
      : workers_(tables.workers),
        counts_(tables.counts),
        scenes_(tables.scenes),
        jobs_(tables.jobs),
        ready_(tables.ready),
        policy_(tables.policy),
        witnesses_(witnesses) {}

  /// Returns whether the worker may be leased units of the job, apart from its credits.
  bool may_work_for(const Worker& worker, const Job& job) const;
  /// Returns whether the worker may be leased this unit of a job that it may work for.
  bool may_take(const Worker& worker, const Job& job, const contract::Unit& unit) const;
  /// Returns the job of which the worker is leased units next, other than those refused; 0 if there
  /// is none.
  JobKey choose_job(const Worker& worker, const std::set<JobKey>& refused);

 private:
  bool has_enough_workers(const Job& job) const;
  bool precedes(const Job& job, const Job& other) const;
  JobKey next_full_job(const Worker& worker, const std::function<bool(JobKey)>& may) const;
  JobKey next_job(const Worker& worker, const std::function<bool(JobKey)>& may);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  LoadedScenes& scenes_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  const SchedulePolicy& policy_;
  Witnesses& witnesses_;
};

}  // namespace tessera::server
