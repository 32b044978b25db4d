#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "contract/unit.h"
#include "server/schedule/plan/job_plan.h"
#include "server/schedule/plan/job_spec.h"
#include "server/schedule/plan/lease.h"

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
  std::vector<std::shared_ptr<const JobSpec>> new_jobs;  // of which `leases` has the first ones
  std::vector<UnitName> revoked;
  std::vector<UnitName> withdrawn;  // revoked units of `leases`, which are sent before
  std::vector<Acknowledgement> acknowledgements;
  std::vector<std::string> ended_jobs;
  bool drain = false;  // finish started units and exit

  bool empty() const {
    return leases.empty() && revoked.empty() && withdrawn.empty() && acknowledgements.empty() &&
           ended_jobs.empty() && !drain;
  }
  /// Whether a lease of this unit is not sent yet.
  bool has_lease(const std::string& job_id, const contract::Unit& unit) const {
    return std::any_of(leases.begin(), leases.end(), [&](const Lease& lease) {
      return lease.job_id == job_id && lease.covers(unit);
    });
  }
  std::size_t size() const {
    return leases.size() + revoked.size() + withdrawn.size() + acknowledgements.size() +
           ended_jobs.size();
  }
};

/// A worker's description of itself when it connects.
struct Hello {
  std::string worker_id, name, host, isa;
  std::string certificate;  // name in its certificate; empty: none
  std::int32_t thread_count = 1;
  std::vector<std::string> tags;
  std::string pool;  // empty: kDefaultPool
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
  std::string witness;      // who answers for its results: see witness_name()
  std::int32_t thread_count = 1;
  std::set<std::string> tags;
  std::string own_pool;          // that it named itself
  std::string pool;              // that it belongs to
  std::set<std::string> serves;  // requirements of jobs that it meets: its pool, with each tag
  bool connected = false;        // has a stream; without one it is lost after the timeout
  bool lost = false;
  bool draining = false;
  bool left = false;         // drained and then disconnected; it is lost as well
  bool quarantined = false;  // fails units that succeed elsewhere, delivered wrong pixels, or is
                             // banned
  bool set_aside = false;    // by an operator
  std::string note;          // why; may be empty
  std::optional<Time> quarantined_until = {};  // it is quarantined for a time: it failed units of
                                               // several jobs and delivered none in between
  bool has_been_audited = false;               // its first unit is, if there is another worker
  Time last_contact;                           // when its last message arrived
  std::int32_t credits = 0;
  std::set<std::pair<JobKey, contract::Unit>> leased_units;
  std::set<JobKey> leased_jobs;  // unfinished jobs of which it was leased units
  JobKey current_job = 0;
  double seconds_in_job = 0;           // CPU seconds committed since it switched to current_job
  std::optional<double> load_seconds;  // load time of current_job's scene on this worker, once
                                       // reported
  std::vector<SceneKey> scenes;        // loaded scenes, latest first; their files are in its cache
  std::int64_t committed_count = 0;
  double cpu_seconds = 0;
  std::int64_t rss_bytes = 0;
  Outbox outbox;
  bool is_counted = false, is_present = false;  // in the scheduler's counts
  std::optional<double> idle_load;  // with credits: the load under which it is in the idle set

  /// Returns whether it may be leased units, apart from credits.
  bool is_working() const { return connected && is_available(); }
  /// The same, also while its stream has just broken.
  bool is_available() const { return !lost && !draining && !quarantined && !set_aside; }
  /// Returns whether it is lost, but would be leased units if it came back.
  bool may_return() const { return lost && !draining && !quarantined && !set_aside; }
  /// Units per thread.
  double load() const { return static_cast<double>(leased_units.size()) / thread_count; }
};

/// Returns the witness to which a worker's results and failures are attributed: its certificate, so
/// that several workers with one certificate count once, else its ID. No ID contains a space.
inline std::string witness_name(const std::string& worker_id, const std::string& certificate) {
  return certificate.empty() ? worker_id : "certificate " + certificate;
}

}  // namespace tessera::server
