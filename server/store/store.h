#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/store/assets/asset_store.h"
#include "server/store/farm/event_store.h"
#include "server/store/farm/settings_store.h"
#include "server/store/farm/usage_store.h"
#include "server/store/farm/worker_store.h"
#include "server/store/files/filesystem.h"
#include "server/store/jobs/frame_store.h"
#include "server/store/jobs/job_store.h"
#include "server/store/jobs/unit_store.h"

namespace tessera::server {

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
  /// Number of removed jobs whose rows are kept.
  std::int64_t max_removed_jobs = 200'000;
  /// Wall clock, µs since 1970; empty: the system's. Used only for the age of assets and joins.
  std::function<std::int64_t()> now_us;
  /// Called with a message when a sync fails. Must not return except in a test, where all later
  /// writes fail with DataLoss. Empty: prints the message to stderr and exits with 1.
  std::function<void(const std::string&)> fatal;
  /// Size of the file that is given up to remove jobs when the disk is full (files/ballast.h). A
  /// second one of a quarter of it is given up to start.
  std::int64_t ballast_bytes = std::int64_t{16} << 20;
  /// Called with a line about a file that does not belong to the store, while it is opened, and
  /// about files that cannot be deleted, on the writing thread. Empty: prints the line to stderr.
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
/// time may call writing functions, of all parts together; any thread may call reading functions.
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

  /// Its directory, for messages.
  virtual const std::string& folder() const = 0;
  /// Random 128-bit ID of the store, hexadecimal, and its secret key (32 bytes) for seals.
  virtual const std::string& id() const = 0;
  virtual const std::string& key() const = 0;
  /// Number of times the store has been opened, including this one; durable before open() returns.
  virtual std::int64_t boot_count() const = 0;

  /// Runs `body`, whose calls of writing functions of any parts make up one transaction with one
  /// sync of the journal: "durable on return" then means on return of this function. A call that
  /// fails leaves the others. On a full disk, a body that removes jobs may run twice. Not within
  /// another.
  ///
  /// Errors: ResourceExhausted, the disk is full, and those of a write; then nothing is written,
  /// whatever the calls returned.
  virtual absl::Status write_together(const std::function<void()>& body) = 0;

  virtual JobStore& jobs() = 0;
  virtual UnitStore& units() = 0;
  virtual const UnitStore& units() const = 0;
  virtual FrameStore& frames() = 0;
  virtual const FrameStore& frames() const = 0;
  virtual AssetStore& assets() = 0;
  virtual const AssetStore& assets() const = 0;
  virtual EventStore& events() = 0;
  virtual const EventStore& events() const = 0;
  virtual const UsageStore& usage() const = 0;
  virtual WorkerStore& workers() = 0;
  virtual SettingsStore& settings() = 0;

  /// Returns the free space of the disk, for this process; 0 if it cannot be told. Any thread.
  virtual std::int64_t free_bytes() const = 0;
  /// Returns the disk space of segments, assets, finished frames and database, without unfinished
  /// uploads. Uses the store's records and visits no directories. Any thread.
  virtual std::int64_t used_bytes() const = 0;
};

}  // namespace tessera::server
