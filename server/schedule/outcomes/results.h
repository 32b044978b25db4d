#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "server/schedule/jobs/job_lifecycle.h"
#include "server/schedule/leasing/dependency_checks.h"
#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/leasing/lease_grants.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"

namespace tessera::server {

/// Records which units and frames are finished, and which must be rendered again.
class Results {
 public:
  Results(Tables& tables, Quarantine& quarantine, DependencyChecks& checks, LeaseGrants& grants,
          Dispatcher& dispatcher, JobLifecycle& lifecycle)
      : workers_(tables.workers),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        audit_table_(tables.audits),
        leases_(tables.leases),
        quarantine_(quarantine),
        checks_(checks),
        grants_(grants),
        dispatcher_(dispatcher),
        lifecycle_(lifecycle) {}

  /// Counts a unit of the journal as committed, without effects.
  void restore_unit(Job& job, const contract::Unit& unit, const std::string& worker_id,
                    double cpu_seconds);
  /// Marks a frame of the journal finished, without effects. See JobPlan::finish().
  void restore_frame(Job& job, std::int32_t frame, std::optional<std::int64_t> unit_count = {});
  /// Counts a worker's share of frames that are finished.
  void restore_contribution(Job& job, const std::string& worker_id, const Contribution& done);
  /// Returns whether `unit` under `lease` belongs to a job that still needs results.
  bool wants(const Job& job, const Lease& lease, const contract::Unit& unit) const;
  /// Records that a unit is durable and revokes its other leases.
  void commit(Job& job, const contract::Unit& unit, const std::string& worker_id,
              double cpu_seconds);
  /// A committed unit's block was damaged and dropped: renders it again.
  void redo(Job& job, const contract::Unit& unit);
  /// Adaptive plans: see JobPlan::reset_pass_targets().
  void reset_pass_targets(Job& job, std::int32_t frame);
  /// Adaptive plans: see JobPlan::set_pass_target().
  void set_pass_target(Job& job, std::int32_t frame, std::int32_t tile, std::int32_t pass_count,
                       bool is_final);
  /// The worker delivered a unit that needs no result; it no longer holds the unit.
  void release_duplicate(Job& job, const contract::Unit& unit, const std::string& worker_id);
  /// The frame's image is durable; ends the job after its last frame.
  void finish_frame(Job& job, std::int32_t frame, Time now);

 private:
  WorkerTable& workers_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  AuditTable& audit_table_;
  LeaseTable& leases_;
  Quarantine& quarantine_;
  DependencyChecks& checks_;
  LeaseGrants& grants_;
  Dispatcher& dispatcher_;
  JobLifecycle& lifecycle_;
};

}  // namespace tessera::server
