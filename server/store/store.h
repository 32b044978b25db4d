#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "contract/unit.h"
#include "server/store/files/filesystem.h"

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
  std::int32_t failure_code = 0;  // absl::StatusCode of a failed job
  std::int64_t create_time_us = 0, end_time_us = 0;  // wall clock, for people only
  double wall_seconds = 0;                           // spent running, added up over restarts
  std::int32_t render_contract = 0;                  // contract::kRenderContract when it was begun
};

/// Whether a committed unit is rendered again by others; the numbers are the journal's.
enum class AuditState : std::int32_t { none = 0, open = 1, over = 2 };

/// A committed unit: where its block lies and what it cost.
struct UnitRecord {
  contract::Unit unit;
  contract::Digest sha256;  // of the encoded block
  std::string worker_id;
  double cpu_seconds = 0;
  std::int64_t segment = 0, offset = 0, size_bytes = 0;  // set by the store
  std::int64_t stored_bytes = 0;                         // on disk
  AuditState audit = AuditState::none;
};

/// What units of a job that is over came to, by the worker that rendered them.
struct UnitTotals {
  std::string worker_id;
  std::int64_t units = 0, audited = 0;
  double cpu_seconds = 0;
};

/// A finished frame: its output file is durable and its blocks may be gone.
struct FrameRecord {
  std::int32_t frame = 0;
  std::string file;  // name within the job's output folder
  contract::Digest file_sha256, pixels_sha256;
  std::string statistics_json;  // the frame's entry of the report
};

/// A worker's joining with a token.
struct Join {
  std::string worker_id;
  std::string token_id;
  std::string certificate;  // name of the worker's
};

/// A unit to commit with its encoded block.
struct Commit {
  std::string job_id;
  UnitRecord record;
  std::string block;  // encoded film block
};

/// What an operator may turn, and what a test replaces.
struct StoreOptions {
  /// A segment file at least this long gets a successor.
  std::int64_t segment_bytes = std::int64_t{256} << 20;
  /// Pages of SQLite's write-ahead log at which it is copied into the database file.
  int checkpoint_pages = 2000;
  /// Free pages the database file may keep; beyond them, and a quarter of it, it shrinks.
  int slack_pages = 256;
  /// Wall clock, µs since 1970; empty: the machine's. Only the age of assets and of joins hangs on
  /// it.
  std::function<std::int64_t()> now_us;
  /// Called with a message when a sync fails; must not return except in a test, where every later
  /// write is refused (DataLoss). Empty: the message goes to stderr and the process exits with 1.
  std::function<void(const std::string&)> fatal;
  /// Told how long each fdatasync of blocks and assets took; any thread. May be empty.
  std::function<void(double seconds)> synced;
};

/// Everything a coordinator must not forget, in one folder: SQLite rows, append-only segment files
/// of film blocks per job, assets, and finished images.
///
/// Order of a commit: append blocks, fdatasync, commit rows (fsync by SQLite), return. A failed
/// fsync is never retried: the process ends (farm.md, section 1). One thread at a time may call the
/// writing functions; reading functions may be called from any thread.
class Store {
 public:
  /// Opens or makes the store in `folder`, whose parent must exist, and locks it (flock). What
  /// earlier processes left unfinished is removed. `filesystem` must outlive the store.
  ///
  /// Errors: FailedPrecondition, another process holds it, or it was written by a newer version;
  /// DataLoss, what is there is damaged (the message says what); PermissionDenied, Unavailable.
  static absl::StatusOr<std::unique_ptr<Store>> open(const std::string& folder,
                                                     Filesystem& filesystem,
                                                     StoreOptions options = {});
  virtual ~Store() = default;

  /// Random 128-bit id of the store, hexadecimal, and its secret key (32 bytes) for seals.
  virtual const std::string& id() const = 0;
  virtual const std::string& key() const = 0;
  /// How often the store has been opened, this time included; durable before open() returns.
  virtual std::int64_t boot_count() const = 0;

  // Jobs.
  /// Adds a job and sets its sequence; durable on return. Errors: AlreadyExists, its id or
  /// request_id is there already, or was and its job is removed; InvalidArgument, its id is no
  /// plain file name ([A-Za-z0-9._-], not starting with a dot). An empty request_id never clashes.
  virtual absl::Status add_job(JobRecord& job) = 0;
  /// Rewrites name, owner, state, reason, request and times of a job. Errors: NotFound.
  virtual absl::Status update_job(const JobRecord& job) = 0;
  /// Deletes the job's rows, segments and outputs. Its id is remembered as used. Errors: NotFound.
  virtual absl::Status remove_job(const std::string& job_id) = 0;
  /// All jobs in order of sequence.
  virtual absl::StatusOr<std::vector<JobRecord>> jobs() const = 0;

  // Units.
  /// Appends and commits many units as one group; durable on return. Fills in where they lie.
  ///
  /// All or nothing. Errors: NotFound, a job is not there; AlreadyExists, a unit is committed
  /// already; ResourceExhausted, the disk is full.
  virtual absl::Status commit(std::vector<Commit>& group) = 0;
  /// Calls visit for each committed unit of a job in order of (frame, tile, pass). `visit` must not
  /// call the store. A job that is not there has no units.
  virtual absl::Status for_each_unit(const std::string& job_id,
                                     const std::function<void(const UnitRecord&)>& visit) const = 0;
  /// The encoded block of a committed unit, verified against its digest.
  ///
  /// Errors: DataLoss, it is damaged (drop the unit and render it again); NotFound, the job is gone
  /// or its blocks were released.
  virtual absl::StatusOr<std::string> read_block(const std::string& job_id,
                                                 const UnitRecord& record) const = 0;
  /// Forgets units (redo): rows first, durable on return.
  virtual absl::Status drop_units(const std::string& job_id,
                                  const std::vector<contract::Unit>& units) = 0;

  /// Audits of these units are over; durable on return.
  virtual absl::Status end_audits(const std::string& job_id,
                                  const std::vector<contract::Unit>& units) = 0;

  // Finished frames.
  /// Where outputs of a job are written; made if needed. Any thread. Errors: InvalidArgument, the
  /// id cannot be a job's.
  virtual absl::StatusOr<std::string> output_folder(const std::string& job_id) = 0;
  /// Records a finished frame whose file is complete in the output folder; syncs the file and
  /// folder first; durable on return. A frame finished before is replaced.
  ///
  /// Errors: NotFound, no such job or file; InvalidArgument, `file` is no plain file name.
  virtual absl::Status finish_frame(const std::string& job_id, const FrameRecord& frame) = 0;
  virtual absl::StatusOr<std::vector<FrameRecord>> frames(const std::string& job_id) const = 0;
  /// A job is over, all of its frames finished: its segments are unlinked, and what the rows of its
  /// units say is added up by worker, so that the journal grows with jobs and not with units.
  /// Harmless to repeat; units committed later start new segments. Errors: NotFound.
  virtual absl::Status close_job(const std::string& job_id) = 0;
  /// What was added up, by worker id. A job that is not there has none.
  virtual absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const = 0;

  // Assets.
  virtual bool has_asset(const contract::Digest& digest) const = 0;
  /// A file to write an upload to; visible only after publish_asset. Any thread.
  virtual absl::StatusOr<std::string> new_upload_path() = 0;
  /// Makes a complete, verified upload visible: fsync, rename, fsync of the folder. From then it is
  /// safe from collect_assets() for an hour. The upload's file is gone afterwards.
  virtual absl::Status publish_asset(const std::string& upload_path,
                                     const contract::Digest& digest) = 0;
  virtual std::string asset_path(const contract::Digest& digest) const = 0;
  /// Jobs no longer name these assets: until now they were in use.
  virtual absl::Status release_assets(const std::vector<contract::Digest>& digests) = 0;
  /// Deletes the assets least recently used (released, else uploaded) until all take at most
  /// `quota_bytes`, but none that was uploaded within the last hour before `now_us` and none that
  /// is `named` by a job.
  virtual absl::Status collect_assets(std::int64_t now_us, std::int64_t quota_bytes,
                                      const std::vector<contract::Digest>& named) = 0;

  // Small durable facts: the roster of workers.
  virtual absl::Status add_worker(const std::string& worker_id, const std::string& name) = 0;
  virtual absl::Status remove_worker(const std::string& worker_id) = 0;
  virtual absl::StatusOr<std::vector<std::string>> roster() const = 0;
  /// Workers that are shut out; durable on return, repeating is harmless.
  virtual absl::Status ban_worker(const std::string& worker_id) = 0;
  virtual absl::Status allow_worker(const std::string& worker_id) = 0;
  virtual absl::StatusOr<std::vector<std::string>> banned_workers() const = 0;

  /// Records that a worker has joined with a token, once per worker and token; durable on return.
  ///
  /// Errors: PermissionDenied, `most` others have (0: no limit), or a worker of this id has joined
  /// with another certificate.
  virtual absl::Status record_join(const Join& join, std::int64_t most) = 0;
  /// Forgets joins of workers that are not in the roster and have not been since `unseen_since_us`,
  /// but none with a token that is still `valid`: those are counted.
  virtual absl::Status remove_stale_joins(const std::vector<std::string>& valid,
                                          std::int64_t unseen_since_us) = 0;

  /// Bytes the store's files take, from its own book-keeping (no folder walk): segments, assets,
  /// finished frames and database, without unfinished uploads. Any thread.
  virtual std::int64_t used_bytes() const = 0;
};

}  // namespace tessera::server
