#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "server/schedule/queue/job_queue.h"

namespace tessera::server {

/// Constants of the schedule (docs/reference/limits.md, docs/explanation/fault-tolerance.md).
struct SchedulePolicy {
  Duration worker_timeout = std::chrono::seconds(5);  // silence after which a worker is lost
  Duration restart_grace = std::chrono::seconds(5);   // after a start, leases wait this long for
                                                      // known workers
  Duration timer_slack = std::chrono::seconds(1);     // a tick that is later than this extends all
                                                      // timeouts
  Duration forget_after = std::chrono::hours(1);      // lost workers are listed this long
  std::int32_t failure_limit = 3;                     // failures of a unit that pause its job
  std::int32_t witness_limit = 2;      // of them, by independent witnesses, where there are others
  std::int32_t loss_limit = 10;        // losses of a unit that its job survives
  std::int32_t disproved_limit = 3;    // failures disproved by others that quarantine a worker
  std::int32_t failing_job_limit = 3;  // jobs of which a worker failed units, none delivered in
                                       // between, that quarantine it
  Duration quarantine_time = std::chrono::minutes(10);
  std::int32_t client_priority = 100;             // maximum for jobs of clients; admins may use any
  std::size_t max_outbox = std::size_t{1} << 17;  // messages that a worker may leave unread
  SharePolicy share;
  Duration audit_timeout = std::chrono::minutes(1);  // a dispute waits this long for other workers
  double audit_fraction = 0.01;  // fraction of units that another worker renders again
  double load_factor = 10;       // a worker stays with a job for this many scene load times
};

/// Checks the priority of a job that a client creates. Errors: PermissionDenied, it is above the
/// clients' maximum.
absl::Status check_client_priority(const SchedulePolicy& policy, std::int32_t priority);

/// Names the store, whose key seals the leases, and counts its starts.
struct StoreIdentity {
  std::string store_id, store_key;
  std::int64_t boot = 0;
};

}  // namespace tessera::server
