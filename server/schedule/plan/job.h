#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "contract/traversal_counts.h"
#include "server/schedule/plan/audit.h"
#include "server/schedule/plan/job_plan.h"
#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// A worker's report that it could not render a unit.
struct Failure {
  std::string worker_id;
  std::string message;
  std::string log_tail;
  std::string witness = {};  // witness_name() of the worker
};

/// Failures and losses of a unit that is not committed.
struct UnitFailures {
  std::vector<Failure> failures;
  std::int32_t losses = 0;
  std::map<std::string, std::int32_t> losses_by_witness = {};
  std::map<std::string, std::int32_t> losses_by_worker = {};  // by ID
  /// Witnesses that failed it, or lost it so often that others should try.
  std::set<std::string> witnesses() const;
};

/// Returns the witnesses of failures.
std::set<std::string> witnesses_of(const std::vector<Failure>& failures);

/// An attempt to render a unit that failed, for users.
struct FailedAttempt {
  contract::Unit unit;
  std::string worker_id;
  std::string message;
  bool operator==(const FailedAttempt&) const = default;
};

/// A worker's share of a job.
struct Contribution {
  std::int64_t units = 0;
  double cpu_seconds = 0;
};

/// CPU seconds per sample, from the latest committed units.
class UnitTimes {
 public:
  void add(double cpu_seconds, std::int32_t sample_count);
  /// Median seconds of a unit with `sample_count` samples per pixel; nullopt before the first unit.
  std::optional<double> median(std::int32_t sample_count) const;

 private:
  static constexpr std::size_t kWindow = 63;
  std::vector<double> per_sample_;
  std::size_t next_ = 0;
};

/// Counters for the report. Those marked * survive a crash exactly, the others are then lower
/// bounds.
struct JobCounters {
  double cpu_seconds = 0;         // * of committed units
  double wasted_cpu_seconds = 0;  // of duplicate and obsolete results
  std::int64_t retried = 0;       // units leased again after a failure or a loss
  std::int64_t duplicated = 0;    // results of units that were already committed
  std::int64_t mismatched = 0;    // of those, results with different bytes
  std::int64_t redone = 0;   // committed units dropped because the block was damaged or its worker
                             // faulty
  std::int64_t audited = 0;  // * committed units with a finished audit
  double load_seconds = 0, build_seconds = 0;
  std::int64_t peak_rss_bytes = 0;
  std::int64_t accelerator_builds = 0;  // frames loaded, over all workers
  double accelerator_build_seconds = 0;
  std::int64_t accelerator_bytes = 0;  // maximum over frames and workers
  contract::TraversalCounts cost;      // of committed units
};

/// Time and memory that a worker needed to load a frame of a job.
struct SceneLoad {
  double load_seconds = 0, build_seconds = 0;
  std::int64_t peak_rss_bytes = 0;
  double accelerator_build_seconds = 0;  // part of build_seconds
  std::int64_t accelerator_bytes = 0;
};

/// Upper bound of a job's needs, or its sum over an owner's unfinished jobs.
struct Demand {
  std::int64_t jobs = 0;
  double store_bytes = 0, samples = 0;
};

/// A job with its state in memory.
struct Job {
  JobKey key = 0;
  std::shared_ptr<const JobSpec> spec;  // owners: the job and its current readers
  SceneKey scene;
  std::string requirement;  // JobSpec::requirement()
  JobState state = JobState::queued;
  Demand demand = {};  // set by JobChanges::set_demand()
  std::string reason;
  /// Set for a job that has failed, or that failures have paused.
  absl::StatusCode failure_code = absl::StatusCode::kOk;
  std::vector<FailedAttempt> failed_attempts;  // because of which it has failed or is paused
  std::int64_t unit_count = 0;                 // of the whole job
  std::int32_t frame_count = 0;
  std::optional<JobPlan> plan;  // created by the first lease
  bool is_blocked = false;      // by another job: none of its units may be leased
  bool is_over_budget = false;  // likewise, by a budget
  bool is_unaudited = false;    // Audits::note_unaudited() has told why
  /// URI of a scene file that the store has lost; empty: none. See JobChanges::lose_asset().
  std::string lost_asset;
  std::set<std::int32_t> blocked_frames;  // each by the same frame of another job
  std::map<contract::Unit, UnitFailures> unit_failures;
  /// By frame: reports that its scene is at fault, at most one by each witness.
  std::map<std::int32_t, std::vector<Failure>> scene_faults;
  std::set<std::string> failed_by;  // witnesses whose failures count against them until it ends
  std::map<contract::Unit, Audit> audits;  // open audits of committed units
  /// By frame: leases of passes beyond the initial ones are void up to this attempt, because the
  /// decisions behind them used results of a faulty worker.
  std::map<std::int32_t, Attempt> voided;
  std::map<WorkerKey, std::int32_t> holders;  // units leased to each worker
  std::set<WorkerKey> ever_leased_to;         // workers that were ever leased units of it
  std::map<std::string, Contribution> contributions;
  UnitTimes times;
  std::int64_t lease_count = 0;  // leases of units and audits, which count against its limits
  double leased_seconds = 0;     // expected CPU seconds of the units in flight
  JobCounters counters;
  double wall_seconds_before = 0;  // running time before `running_since`
  std::optional<Time> running_since;
  std::optional<Time> waiting_since;  // since when units could be leased and none is
  std::int64_t create_time_us = 0, end_time_us = 0;

  double wall_seconds(Time now) const {
    return wall_seconds_before + (running_since ? seconds(now - *running_since) : 0);
  }
  /// Returns whether units kept failing on independent workers; JobLifecycle::retry() resumes it.
  bool is_paused_by_failures() const {
    return state == JobState::paused && failure_code != absl::StatusCode::kOk;
  }
  /// Returns whether units could be leased: the job is active and units are waiting, which neither
  /// another job nor a budget blocks.
  bool is_runnable() const {
    if (is_blocked || is_over_budget) return false;
    if (state != JobState::queued && state != JobState::running) return false;
    if (plan) return plan->counts().waiting > 0;
    return blocked_frames.size() < static_cast<std::size_t>(frame_count);
  }
  /// Creates the plan if there is none.
  JobPlan& open_plan();
  /// Blocks a frame, or lets its units be leased.
  void block_frame(std::int32_t frame, bool is_frame_blocked);
};

}  // namespace tessera::server
