#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/leasing/job_states.h"
#include "server/schedule/outcomes/failures.h"
#include "server/schedule/outcomes/results.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"

namespace tessera::server {

/// Handles the messages of workers: connecting, heartbeats, credits, returned units.
class Connections {
 public:
  Connections(Tables& tables, Quarantine& quarantine, JobStates& states, Dispatcher& dispatcher,
              Results& results, Failures& failures)
      : workers_(tables.workers),
        counts_(tables.counts),
        scenes_(tables.scenes),
        placement_(tables.placement),
        absences_(tables.absences),
        jobs_(tables.jobs),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        leases_(tables.leases),
        identity_(tables.identity),
        quarantine_(quarantine),
        states_(states),
        dispatcher_(dispatcher),
        results_(results),
        failures_(failures) {}

  /// Notes that the worker's stream broke; the worker is lost after the timeout.
  void disconnect(WorkerKey key);
  /// Starts a worker's new stream: adopts running and unacknowledged units under valid seals, and
  /// releases all others.
  WorkerKey connect(const Hello& hello, Time now);
  /// Notes that a message arrived.
  void record_contact(WorkerKey key, Time now);
  void heartbeat(WorkerKey key, const std::vector<UnitName>& started, std::int64_t rss_bytes,
                 Time now);
  void grant_credits(WorkerKey key, std::int32_t count, Time now);
  /// Leases the worker nothing more; it finishes the units that it has. Returns whether this is
  /// new.
  bool begin_draining(WorkerKey key);
  /// The worker returned units that it had not started. `lacks_files`: because it could not fetch
  /// the scenes of their jobs.
  void return_units(WorkerKey key, const std::vector<UnitName>& units, Time now,
                    bool lacks_files = false);
  void scene_loaded(WorkerKey key, const std::string& job_id, const SceneLoad& load);
  void acknowledge(WorkerKey key, Acknowledgement acknowledgement);

 private:
  void adopt(Worker& worker, const Hello& hello, Time now);
  void release_unlisted(Worker& worker,
                        const std::map<std::pair<JobKey, contract::Unit>, Attempt>& listed,
                        Time now);

  WorkerTable& workers_;
  WorkerCounts& counts_;
  LoadedScenes& scenes_;
  Placement& placement_;
  Absences& absences_;
  JobTable& jobs_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  LeaseTable& leases_;
  const StoreIdentity& identity_;
  Quarantine& quarantine_;
  JobStates& states_;
  Dispatcher& dispatcher_;
  Results& results_;
  Failures& failures_;
};

}  // namespace tessera::server
