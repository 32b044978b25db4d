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

/// A unit with the job it belongs to, as the wire names it.
struct UnitName {
  std::string job_id;
  contract::Unit unit;
  auto operator<=>(const UnitName&) const = default;
};

/// What became of a delivered block.
enum class AckStatus : std::uint8_t { committed = 1, duplicate = 2, obsolete = 3, rejected = 4 };

struct Acknowledgement {
  UnitName unit;
  AckStatus status = AckStatus::committed;
  std::string reason;
};

/// What is to be told to a worker. Filled under the coordinator's lock, sent outside it.
struct Outbox {
  std::vector<Lease> leases;
  std::vector<UnitName> revoked;
  std::vector<Acknowledgement> acknowledgements;
  std::vector<std::string> ended_jobs;
  bool drain = false;  // it is to go

  bool empty() const {
    return leases.empty() && revoked.empty() && acknowledgements.empty() && ended_jobs.empty() &&
           !drain;
  }
};

/// What a worker says of itself when it connects.
struct Hello {
  std::string worker_id, name, host, isa;
  std::string certificate;  // name it was issued to; empty: none
  std::int32_t thread_count = 1;
  std::vector<std::string> tags;
  std::int32_t credit_count = 0;
  std::string store_id;  // of the leases below
  std::vector<Lease> leases;
  std::vector<UnitName> running, unacknowledged;
};

/// A worker that is connected, or was lately. Units it holds are named by (job, unit).
struct Worker {
  WorkerKey key = 0;
  std::string id, name, host, isa;
  std::string certificate;  // name it was issued to; empty: none
  std::int32_t thread_count = 1;
  std::set<std::string> tags;
  bool connected = false;  // has a stream; without one it is lost after the time-out
  bool lost = false;
  bool draining = false;
  bool quarantined = false;    // fails units that succeed elsewhere, lies, or is banned
  bool has_delivered = false;  // has delivered a unit; its first is always audited
  Time last_contact;           // last sign of life
  std::int32_t credits = 0;
  std::set<std::pair<JobKey, contract::Unit>> held;
  std::set<JobKey> leased_jobs;  // not ended, of which it was ever leased units
  JobKey current_job = 0;
  double seconds_in_job = 0;           // CPU seconds committed since it turned to current_job
  std::optional<double> load_seconds;  // of current_job's scene here, once it is loaded
  std::vector<SceneKey> scenes;        // it has loaded, latest first: their files are here
  std::int64_t committed_count = 0;
  double cpu_seconds = 0;
  std::int64_t rss_bytes = 0;
  std::int32_t disproved_failures = 0;  // units it failed that succeeded elsewhere
  Outbox outbox;

  /// Whether it may be leased units, credits apart.
  bool is_working() const { return connected && !lost && !draining && !quarantined; }
};

}  // namespace tessera::server
