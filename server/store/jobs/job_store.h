#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/unit.h"

namespace tessera::server {

/// A job's row: its durable state. `request` is the serialised v1.CreateJobRequest.
struct JobRecord {
  std::string id;
  std::int64_t sequence = 0;  // order of submission, never reused; set by the store
  std::string request_id;
  std::string name;
  std::string owner;
  std::string request;
  std::int32_t state = 0;  // v1.Job.State
  std::string reason;
  std::int32_t failure_code = 0;                     // absl::StatusCode of a failed job
  std::int64_t create_time_us = 0, end_time_us = 0;  // wall clock, for display only
  std::int64_t end_served_us = 0;                    // FarmView::served_us() at its end
  double wall_seconds = 0;                           // running time, summed over restarts
  std::int32_t render_contract = 0;                  // contract::kRenderContract of its first lease
  std::string project;
  std::string failed_attempts;  // JSON; opaque here
};

/// The jobs. One thread at a time may call writing functions, that of Store; any thread may call
/// reading functions.
class JobStore {
 public:
  virtual ~JobStore() = default;

  /// Adds a job and sets its sequence; durable on return. Errors: AlreadyExists, its ID or
  /// request_id is or was in use; InvalidArgument, its ID is not a plain file name ([A-Za-z0-9._-],
  /// not starting with a dot). An empty request_id never conflicts.
  virtual absl::Status add(JobRecord& job) = 0;
  /// Rewrites name, owner, state, reason, request and times of a job. Errors: NotFound.
  virtual absl::Status update(const JobRecord& job) = 0;
  /// Rewrites a job's row like update() and removes committed units that its new settings do not
  /// have, in one transaction. Errors: NotFound.
  virtual absl::Status rewrite(const JobRecord& job,
                               const std::vector<contract::Unit>& dropped) = 0;
  /// Deletes the job's rows, segments and outputs. Of the newest removed jobs
  /// (StoreOptions::max_removed_jobs, and up to 5 % more) the IDs stay reserved, and the accounts
  /// name the jobs; of older ones only the usage stays. Files that cannot be deleted are orphans,
  /// which the next open deletes. Errors: NotFound.
  virtual absl::Status remove(const std::string& job_id) = 0;

  /// Returns all jobs in order of sequence.
  virtual absl::StatusOr<std::vector<JobRecord>> list() const = 0;
  /// Returns the state (v1.Job.State) in which a job was removed; nullopt for a job that is not
  /// removed; 0 for one without a row, which was removed long ago.
  virtual absl::StatusOr<std::optional<std::int32_t>> removed_state(
      const std::string& job_id) const = 0;
};

}  // namespace tessera::server
