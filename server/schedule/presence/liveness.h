#pragma once

#include "server/schedule/outcomes/failures.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"

namespace tessera::server {

/// Detects workers that have gone silent, and takes back their units.
class Liveness {
 public:
  Liveness(Tables& tables, Quarantine& quarantine, Failures& failures)
      : workers_(tables.workers),
        counts_(tables.counts),
        scenes_(tables.scenes),
        absences_(tables.absences),
        jobs_(tables.jobs),
        outgoing_(tables.outgoing),
        policy_(tables.policy),
        quarantine_(quarantine),
        failures_(failures) {}

  /// Takes back the units of workers that have been silent too long, and forgets those that have
  /// been lost for long.
  void expire(Time now);
  /// Extends all timeouts, as this process was suspended so long.
  void extend(Duration late);
  /// Gives up workers that have not come back since the restart, at the end of the grace time.
  void end_grace(Time now);

 private:
  void mark_lost(Worker& worker, Time now);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  LoadedScenes& scenes_;
  Absences& absences_;
  JobTable& jobs_;
  Outgoing& outgoing_;
  const SchedulePolicy& policy_;
  Quarantine& quarantine_;
  Failures& failures_;
};

}  // namespace tessera::server
