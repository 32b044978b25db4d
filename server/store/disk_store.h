#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "server/store/assets/disk_assets.h"
#include "server/store/farm/event_rows.h"
#include "server/store/farm/settings_rows.h"
#include "server/store/farm/usage_rows.h"
#include "server/store/farm/worker_rows.h"
#include "server/store/files/durable_files.h"
#include "server/store/jobs/frame_rows.h"
#include "server/store/jobs/job_rows.h"
#include "server/store/jobs/unit_rows.h"
#include "server/store/sqlite/disk_reserve.h"
#include "server/store/sqlite/journal.h"
#include "server/store/store.h"

namespace tessera::server {

// clang-format off
/// The store in a directory (see Store):
///
///   lock                    held by the process that uses the store
///   store.db                rows, small film blocks, images and assets
///   store.db-wal, -shm      SQLite's
///   segments/JOB/N.seg      film blocks
///   assets/ab/cdef…         large assets by digest
///   assets/upload           incomplete uploads
///   outputs/JOB/…           large finished images
///   ballast, ballast.start  space that is given up when the disk is full
///   backup-…                hard links of a backup that is running
///
/// Rows are authoritative. A file is durable before its row is written and deleted after its row,
/// so files without a row are orphans; the next open deletes them.
// clang-format on
class DiskStore final : public Store {
 public:
  static absl::StatusOr<std::unique_ptr<Store>> open(const std::string& folder,
                                                     Filesystem& filesystem, StoreOptions options);

  const std::string& folder() const override { return folder_; }
  const std::string& id() const override { return id_; }
  const std::string& key() const override { return key_; }
  std::int64_t boot_count() const override { return boot_count_; }

  absl::Status write_together(const std::function<void()>& body) override;

  JobStore& jobs() override { return *jobs_; }
  UnitStore& units() override { return *units_; }
  const UnitStore& units() const override { return *units_; }
  FrameStore& frames() override { return *frames_; }
  const FrameStore& frames() const override { return *frames_; }
  AssetStore& assets() override { return *assets_; }
  const AssetStore& assets() const override { return *assets_; }
  EventStore& events() override { return *events_; }
  const EventStore& events() const override { return *events_; }
  const UsageStore& usage() const override { return *usage_; }
  WorkerStore& workers() override { return *workers_; }
  SettingsStore& settings() override { return *settings_; }

  std::int64_t free_bytes() const override;
  std::int64_t used_bytes() const override;

 private:
  DiskStore(std::string folder, Filesystem& filesystem, StoreOptions options);
  absl::Status make_folders();
  absl::Status start();
  absl::Status clean_up();
  void remove_links();

  StoreOptions options_;
  std::string folder_;
  DurableFiles files_;
  DiskReserve reserve_;
  std::unique_ptr<FileLock> lock_;
  std::unique_ptr<Journal> journal_;
  std::unique_ptr<EventRows> events_;
  std::unique_ptr<UsageRows> usage_;
  std::unique_ptr<WorkerRows> workers_;
  std::unique_ptr<SettingsRows> settings_;
  std::unique_ptr<DiskAssets> assets_;
  std::unique_ptr<UnitRows> units_;
  std::unique_ptr<FrameRows> frames_;
  std::unique_ptr<JobRows> jobs_;
  std::string id_, key_;
  std::int64_t boot_count_ = 0;
};

}  // namespace tessera::server
