#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "contract/unit.h"
#include "server/schedule/job_plan.h"
#include "server/schedule/job_spec.h"
#include "server/schedule/lease.h"

namespace tessera::server {

/// A unit and its job, as in messages.
struct UnitName {
  std::string job_id;
  contract::Unit unit;
  auto operator<=>(const UnitName&) const = default;
};

/// Outcome of a delivered block; numbers as in v1.Acknowledgement.AckStatus.
enum class AckStatus : std::uint8_t { committed = 1, duplicate = 2, obsolete = 3, rejected = 4 };

struct Acknowledgement {
  UnitName unit;
  AckStatus status = AckStatus::committed;
  std::string reason;
};

/// Messages for a worker. Filled under the coordinator's lock, sent without it.
struct Outbox {
  std::vector<Lease> leases;
  std::vector<UnitName> revoked;
  std::vector<Acknowledgement> acknowledgements;
  std::vector<std::string> ended_jobs;
  bool drain = false;  // finish started units and exit

  bool empty() const {
    return leases.empty() && revoked.empty() && acknowledgements.empty() && ended_jobs.empty() &&
           !drain;
  }
};

/// A worker's description of itself when it connects.
struct Hello {
  std::string worker_id, name, host, isa;
  std::string certificate;  // name in its certificate; empty: none
  std::int32_t thread_count = 1;
  std::vector<std::string> tags;
  std::int32_t credit_count = 0;
  std::string store_id;  // store of the leases below
  std::vector<Lease> leases;
  std::vector<UnitName> running, unacknowledged;
};

/// A worker that is connected or was recently.
struct Worker {
  WorkerKey key = 0;
  std::string id, name, host, isa;
  std::string certificate;  // name in its certificate; empty: none
  std::int32_t thread_count = 1;
  std::set<std::string> tags;
  bool connected = false;  // has a stream; without one it is lost after the timeout
  bool lost = false;
  bool draining = false;
  bool quarantined = false;    // fails units that succeed elsewhere, delivered wrong pixels, or is
                               // banned
  bool has_delivered = false;  // its first unit is always audited
  Time last_contact;           // when its last message arrived
  std::int32_t credits = 0;
  std::set<std::pair<JobKey, contract::Unit>> leased_units;
  std::set<JobKey> leased_jobs;  // unfinished jobs of which it was leased units
  JobKey current_job = 0;
  double seconds_in_job = 0;           // CPU seconds committed since it switched to current_job
  std::optional<double> load_seconds;  // load time of current_job's scene on this worker, once
                                       // loaded
  std::vector<SceneKey> scenes;        // loaded scenes, latest first; their files are in its cache
  std::int64_t committed_count = 0;
  double cpu_seconds = 0;
  std::int64_t rss_bytes = 0;
  std::int32_t disproved_failures = 0;  // units that it failed and another worker rendered
  Outbox outbox;

  /// Returns whether it may be leased units, apart from credits.
  bool is_working() const { return connected && !lost && !draining && !quarantined; }
};

}  // namespace tessera::server
