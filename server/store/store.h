#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "proto/contract/digest.h"
#include "proto/contract/unit.h"
#include "server/store/filesystem.h"

namespace tessera::server {

/// A job's row: what must survive a restart. `request` is the serialised v1.CreateJobRequest.
struct JobRecord {
  std::string id;
  std::int64_t sequence = 0;  // order of submission, never reused; set by the store
  std::string request_id;
  std::string name;
  std::string owner;
  std::string request;
  std::int32_t state = 0;  // v1.Job.State
  std::string reason;
  std::int64_t create_time_us = 0, end_time_us = 0;  // wall clock, for people only
  double wall_seconds = 0;                           // spent running, added up over restarts
};

/// A committed unit: where its block lies and what it cost.
struct UnitRecord {
  contract::Unit unit;
  contract::Digest sha256;  // of the encoded block
  std::string worker_id;
  double cpu_seconds = 0;
  std::int64_t segment = 0, offset = 0, size_bytes = 0;  // set by the store
  std::int64_t stored_bytes = 0;                         // on disk; may be compressed
};

/// A finished frame: its output file is durable and its blocks may be gone.
struct FrameRecord {
  std::int32_t frame = 0;
  std::string file;  // name within the job's output folder
  contract::Digest file_sha256, pixels_sha256;
  std::string statistics_json;  // the frame's entry of the report
};

/// A unit to commit with its encoded block.
struct Commit {
  std::string job_id;
  UnitRecord record;
  std::string block;  // encoded film block
};

/// Everything a coordinator must not forget, in one folder: SQLite rows, append-only segment files
/// of film blocks per job, assets, and finished images.
///
/// Order of a commit: append blocks, fdatasync, commit rows (fsync by SQLite), return. A failed
/// fsync is never retried: the process ends (farm.md, section 1). One thread at a time may call the
/// writing functions; reading functions may be called from any thread.
class Store {
 public:
  /// Opens or makes the store in `folder` and locks it (flock).
  ///
  /// Errors: FailedPrecondition, another process holds it, or it was written by a newer version;
  /// DataLoss, what is there is damaged (the message says what); PermissionDenied, Unavailable.
  static absl::StatusOr<std::unique_ptr<Store>> open(const std::string& folder,
                                                     Filesystem& filesystem);
  virtual ~Store() = default;

  /// Random 128-bit id of the store, hexadecimal, and its secret key (32 bytes) for seals.
  virtual const std::string& id() const = 0;
  virtual const std::string& key() const = 0;
  /// How often the store has been opened, this time included; durable before open() returns.
  virtual std::int64_t boot_count() const = 0;

  // Jobs.
  /// Adds a job and sets its sequence; durable on return. Errors: AlreadyExists, its id or
  /// request_id is there already.
  virtual absl::Status add_job(JobRecord& job) = 0;
  /// Rewrites state, reason, request, times of a job.
  virtual absl::Status update_job(const JobRecord& job) = 0;
  /// Deletes the job's rows, segments and outputs. Its id is remembered as used.
  virtual absl::Status remove_job(const std::string& job_id) = 0;
  /// All jobs in order of sequence.
  virtual absl::StatusOr<std::vector<JobRecord>> jobs() const = 0;

  // Units.
  /// Appends and commits many units as one group; durable on return. Fills in where they lie.
  virtual absl::Status commit(std::vector<Commit>& group) = 0;
  /// Calls visit for each committed unit of a job in order of (frame, tile, pass).
  virtual absl::Status for_each_unit(const std::string& job_id,
                                     const std::function<void(const UnitRecord&)>& visit) const = 0;
  /// The encoded block of a committed unit, verified against its digest. Errors: DataLoss.
  virtual absl::StatusOr<std::string> read_block(const std::string& job_id,
                                                 const UnitRecord& record) const = 0;
  /// Forgets units (redo): rows first, durable on return.
  virtual absl::Status drop_units(const std::string& job_id,
                                  const std::vector<contract::Unit>& units) = 0;

  // Finished frames.
  /// Where outputs of a job are written; made if needed.
  virtual absl::StatusOr<std::string> output_folder(const std::string& job_id) = 0;
  /// Records a finished frame whose file is complete in the output folder; syncs the file and
  /// folder first; durable on return.
  virtual absl::Status finish_frame(const std::string& job_id, const FrameRecord& frame) = 0;
  virtual absl::StatusOr<std::vector<FrameRecord>> frames(const std::string& job_id) const = 0;
  /// Unlinks the segments of a job all of whose frames are finished.
  virtual absl::Status release_segments(const std::string& job_id) = 0;

  // Assets.
  virtual bool has_asset(const contract::Digest& digest) const = 0;
  /// A file to write an upload to; visible only after keep_asset.
  virtual absl::StatusOr<std::string> new_upload_path() = 0;
  /// Makes a complete, verified upload visible: fsync, rename, fsync of the folder.
  virtual absl::Status keep_asset(const std::string& upload_path,
                                  const contract::Digest& digest) = 0;
  virtual std::string asset_path(const contract::Digest& digest) const = 0;

  // Small durable facts: the roster of workers.
  virtual absl::Status remember_worker(const std::string& worker_id, const std::string& name) = 0;
  virtual absl::Status forget_worker(const std::string& worker_id) = 0;
  virtual absl::StatusOr<std::vector<std::string>> roster() const = 0;

  /// Bytes the store's files take, from its own book-keeping (no folder walk).
  virtual std::int64_t used_bytes() const = 0;
};

}  // namespace tessera::server
