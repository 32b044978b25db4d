#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "contract/unit.h"
#include "server/store/asset_store.h"
#include "server/store/event_store.h"
#include "server/store/files/filesystem.h"
#include "server/store/usage_store.h"
#include "server/store/worker_store.h"

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
  double wall_seconds = 0;                           // running time, summed over restarts
  std::int32_t render_contract = 0;                  // contract::kRenderContract of its first lease
  std::string project;
  std::string failed_attempts;  // JSON; opaque here
};

/// State of a committed unit's audit; the numbers are stored.
enum class AuditState : std::int32_t { none = 0, open = 1, ended = 2 };

/// A committed unit: location and cost of its block.
struct UnitRecord {
  contract::Unit unit;
  contract::Digest sha256;  // of the encoded block
  std::string worker_id;
  double cpu_seconds = 0;
  std::int64_t segment = 0, offset = 0, size_bytes = 0;  // set by the store; segment -1: in a row
  std::int64_t stored_bytes = 0;                         // size on disk
  AuditState audit = AuditState::none;
};

/// Sums over units of a finished job, by worker.
struct UnitTotals {
  std::string worker_id;
  std::int64_t units = 0, audited = 0;
  double cpu_seconds = 0;
};

/// A finished frame: its image is durable; its blocks may be deleted.
struct FrameRecord {
  std::int32_t frame = 0;
  std::string file;  // name within the job's output directory
  contract::Digest file_sha256, pixels_sha256;
  std::string statistics_json;   // a FrameSummary
  std::int64_t image_bytes = 0;  // of a frame that is being finished; not read back
};

/// Kind of the farm's settings; the numbers are stored.
enum class SettingKind : std::int32_t {
  limit = 1,  // units, by limit
  pool = 2,   // pool, by worker that an operator moved
  use = 3,    // CPU seconds that count in fair share, by owner
  aside = 4,  // reason, by worker that an operator set aside
  budget = 5  // by account
};
/// Settings of one kind, by name.
using Settings = std::map<std::string, std::string>;

/// A unit to commit, with its encoded block.
struct Commit {
  std::string job_id;
  UnitRecord record;
  std::string block;  // encoded film block
};

/// Settings of a store; tests replace some.
struct StoreOptions {
  /// Size at which a segment file is closed and a new one started.
  std::int64_t segment_bytes = std::int64_t{256} << 20;
  /// Sizes up to which a block, an image and an asset are stored in the database, where a group of
  /// them needs one sync, and the total of such blocks of a job; larger ones have files. 0: always
  /// files.
  std::int64_t row_block_bytes = 16 << 10, row_image_bytes = 64 << 10, row_asset_bytes = 64 << 10;
  std::int64_t row_blocks_per_job_bytes = 128 << 10;
  /// Pages of SQLite's write-ahead log at which it is copied into the database file.
  int checkpoint_pages = 2000;
  /// Free pages that the database file may keep; with more, and more than a quarter of the file, it
  /// is shrunk.
  int slack_pages = 256;
  /// Number of events that are kept.
  std::int64_t max_events = 200'000;
  /// Wall clock, µs since 1970; empty: the system's. Used only for the age of assets and joins.
  std::function<std::int64_t()> now_us;
  /// Called with a message when a sync fails. Must not return except in a test, where all later
  /// writes fail with DataLoss. Empty: prints the message to stderr and exits with 1.
  std::function<void(const std::string&)> fatal;
  /// Size of the file that is given up to remove jobs when the disk is full (files/ballast.h). A
  /// second one of a quarter of it is given up to start.
  std::int64_t ballast_bytes = std::int64_t{16} << 20;
  /// Called with a line about a file that does not belong to the store, while it is opened. Empty:
  /// prints the line to stderr.
  std::function<void(const std::string&)> warn;
  /// Called with the duration of each fdatasync of blocks and assets and of each commit of rows, on
  /// any thread. May be empty.
  std::function<void(double seconds)> synced;
};

/// The coordinator's durable state in one directory: SQLite rows, append-only segment files of film
/// blocks per job, assets, and finished images. Small blocks, images and assets are in rows, so
/// that many small jobs share a sync.
///
/// Order of a commit: append blocks, fdatasync, commit rows (fsync by SQLite), return. A failed
/// fsync is never retried: the process ends (docs/explanation/fault-tolerance.md). One thread at a
/// time may call writing functions; any thread may call reading functions.
class Store {
 public:
  /// Opens the store in `folder`, creates it if missing (the parent must exist), and locks it
  /// (flock). Deletes what earlier processes left unfinished. `filesystem` must outlive the store.
  ///
  /// Errors: FailedPrecondition, another process holds it, or a newer version wrote it; DataLoss,
  /// it is damaged (the message says how); PermissionDenied; Unavailable.
  static absl::StatusOr<std::unique_ptr<Store>> open(const std::string& folder,
                                                     Filesystem& filesystem,
                                                     StoreOptions options = {});
  virtual ~Store() = default;

  /// Random 128-bit ID of the store, hexadecimal, and its secret key (32 bytes) for seals.
  virtual const std::string& id() const = 0;
  virtual const std::string& key() const = 0;
  /// Number of times the store has been opened, including this one; durable before open() returns.
  virtual std::int64_t boot_count() const = 0;

  /// Runs `body`, whose calls of writing functions make up one transaction with one sync of the
  /// journal: "durable on return" then means on return of this function. A call that fails leaves
  /// the others. On a full disk, a body that removes jobs may run twice. Not within another.
  ///
  /// Errors: ResourceExhausted, the disk is full, and those of a write; then nothing is written,
  /// whatever the calls returned.
  virtual absl::Status write_together(const std::function<void()>& body) = 0;

  /// Adds a job and sets its sequence; durable on return. Errors: AlreadyExists, its ID or
  /// request_id is or was in use; InvalidArgument, its ID is not a plain file name ([A-Za-z0-9._-],
  /// not starting with a dot). An empty request_id never conflicts.
  virtual absl::Status add_job(JobRecord& job) = 0;
  /// Rewrites name, owner, state, reason, request and times of a job. Errors: NotFound.
  virtual absl::Status update_job(const JobRecord& job) = 0;
  /// Deletes the job's rows, segments and outputs. Its ID stays reserved; its name, owner and
  /// project stay for the accounts. Errors: NotFound.
  virtual absl::Status remove_job(const std::string& job_id) = 0;
  /// Returns all jobs in order of sequence.
  virtual absl::StatusOr<std::vector<JobRecord>> jobs() const = 0;
  /// Returns the state (v1.Job.State) in which a job was removed; nullopt for any other job.
  virtual absl::StatusOr<std::optional<std::int32_t>> removed_state(
      const std::string& job_id) const = 0;

  /// Appends and commits units as one group, all or none; durable on return. Sets their locations.
  ///
  /// Errors: NotFound, no such job; AlreadyExists, a unit is already committed; ResourceExhausted,
  /// the disk is full.
  virtual absl::Status commit(std::vector<Commit>& group) = 0;
  /// Calls `visit` for each committed unit of a job in order of (frame, tile, pass). `visit` must
  /// not call the store. An unknown job has no units.
  virtual absl::Status for_each_unit(const std::string& job_id,
                                     const std::function<void(const UnitRecord&)>& visit) const = 0;
  /// Returns the encoded block of a committed unit, verified against its digest.
  ///
  /// Errors: DataLoss, it is damaged (drop the unit and render it again); NotFound, the job is
  /// removed or its blocks are released.
  virtual absl::StatusOr<std::string> read_block(const std::string& job_id,
                                                 const UnitRecord& record) const = 0;
  /// Rewrites a job's row like update_job() and removes committed units that its new settings do
  /// not have, in one transaction. Errors: NotFound.
  virtual absl::Status rewrite_job(const JobRecord& job,
                                   const std::vector<contract::Unit>& dropped) = 0;
  /// Removes committed units, to be rendered again, with their charge; durable on return.
  virtual absl::Status drop_units(const std::string& job_id,
                                  const std::vector<contract::Unit>& units) = 0;

  /// Records that the audits of these units have ended; durable on return.
  virtual absl::Status end_audits(const std::string& job_id,
                                  const std::vector<contract::Unit>& units) = 0;

  /// Returns the directory for outputs of a job, created if missing. Any thread. Errors:
  /// InvalidArgument, not a valid job ID.
  virtual absl::StatusOr<std::string> output_folder(const std::string& job_id) = 0;
  /// Records a finished frame whose file is complete in the output directory; durable on return.
  /// Syncs file and directory first. Replaces an earlier record of the frame.
  ///
  /// Errors: NotFound, no such job or file; InvalidArgument, `file` is not a plain file name.
  virtual absl::Status finish_frame(const std::string& job_id, const FrameRecord& frame) = 0;
  /// Size up to which an image is a row, 0: none. Any thread.
  virtual std::int64_t max_row_image_bytes() const = 0;
  /// The same for a small image, which becomes a row without a file. Errors: as finish_frame().
  virtual absl::Status finish_small_frame(const std::string& job_id, const FrameRecord& frame,
                                          const std::string& image) = 0;
  /// Rewrites the statistics of a finished frame. Errors: NotFound.
  virtual absl::Status update_statistics(const std::string& job_id, std::int32_t frame,
                                         const std::string& statistics_json) = 0;
  /// Returns the image of a finished frame that is stored in a row; nothing if it is a file in the
  /// output directory. Any thread.
  virtual absl::StatusOr<std::optional<std::string>> row_image(const std::string& job_id,
                                                               std::int32_t frame) const = 0;
  virtual absl::StatusOr<std::vector<FrameRecord>> frames(const std::string& job_id) const = 0;
  /// Closes a job whose frames are all finished: deletes its segments and replaces the rows of its
  /// units by sums per worker, so that the journal grows with jobs and not with units. Idempotent;
  /// units committed later start new segments. Errors: NotFound.
  virtual absl::Status close_job(const std::string& job_id) = 0;
  /// Returns the sums of close_job() by worker ID. An unknown job has none.
  virtual absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const = 0;

  virtual AssetStore& assets() = 0;
  virtual const AssetStore& assets() const = 0;

  virtual WorkerStore& workers() = 0;
  virtual const WorkerStore& workers() const = 0;
  virtual EventStore& events() = 0;
  virtual const EventStore& events() const = 0;
  virtual const UsageStore& usage() const = 0;

  /// Replaces all settings of a kind; durable on return.
  virtual absl::Status save_settings(SettingKind kind, const Settings& settings) = 0;
  virtual absl::StatusOr<Settings> settings(SettingKind kind) const = 0;

  /// Returns the free space of the disk, for this process; 0 if it cannot be told. Any thread.
  virtual std::int64_t free_bytes() const = 0;
  /// Returns the disk space of segments, assets, finished frames and database, without unfinished
  /// uploads. Uses the store's records and visits no directories. Any thread.
  virtual std::int64_t used_bytes() const = 0;
};

}  // namespace tessera::server
