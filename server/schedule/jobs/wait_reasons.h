#pragma once

#include <cstdint>
#include <string>

#include "server/schedule/leasing/dependency_checks.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/witnesses.h"

namespace tessera::server {

/// Why an active job is leased nothing.
enum class WaitReason : std::uint8_t {
  none,          // it is being rendered, or nothing of it is waiting
  budget,        // the budget of its owner or project is used up
  dependency,    // another job must make progress first
  no_workers,    // no worker at all
  no_pool,       // no worker in the pool
  no_tag,        // no worker in the pool with the required tag
  blocked,       // all workers in the pool with the tag are blocked for it
  lost_asset,    // the store has lost a file of its scene, which no worker has
  restart,       // after a restart, workers that hold leases may come back
  limit,         // all units of a limit are in use
  priority,      // jobs of higher priority go first
  share,         // an owner that has used less goes first
  older_job,     // an older job of the same owner goes first
  other_worker,  // its waiting units failed; they wait for another worker
  farm_busy,     // all workers are busy
};

/// Determines why jobs are leased nothing, for their owners.
class WaitReasons {
 public:
  WaitReasons(const Tables& tables, const Witnesses& witnesses, const DependencyChecks& checks)
      : counts_(tables.counts),
        absences_(tables.absences),
        stopped_(tables.stopped),
        ready_(tables.ready),
        witnesses_(witnesses),
        checks_(checks) {}

  /// Returns why the job is leased nothing. Cost: a few look-ups, whatever the number of jobs.
  WaitReason wait_reason(const Job& job) const;
  /// The same for users; "" for WaitReason::none.
  std::string wait_text(const Job& job) const;

 private:
  const WorkerCounts& counts_;
  const Absences& absences_;
  const StoppedAccounts& stopped_;
  const ReadyJobs& ready_;
  const Witnesses& witnesses_;
  const DependencyChecks& checks_;
};

}  // namespace tessera::server
