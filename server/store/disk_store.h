#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/store/disk_assets.h"
#include "server/store/event_rows.h"
#include "server/store/files/ballast.h"
#include "server/store/files/durable_files.h"
#include "server/store/files/segments.h"
#include "server/store/sqlite/journal.h"
#include "server/store/store.h"
#include "server/store/usage_rows.h"
#include "server/store/worker_rows.h"

namespace tessera::server {

/// The store in a directory (see Store):
///
///   lock               held by the process that uses the store
///   store.db           rows, small film blocks, images and assets; -wal and -shm beside it are
///   SQLite's segments/JOB/N.seg film blocks assets/ab/cdef…    large assets by digest;
///   assets/upload: incomplete uploads outputs/JOB/…      large finished images
///
///   ballast, ballast.start  space that is given up when the disk is full
///   backup-…           hard links of a backup that is running
///
/// Rows are authoritative. A file is durable before its row is written and deleted after its row,
/// so files without a row are orphans; the next open deletes them.
class DiskStore final : public Store {
 public:
  static absl::StatusOr<std::unique_ptr<Store>> open(const std::string& folder,
                                                     Filesystem& filesystem, StoreOptions options);

  const std::string& id() const override { return id_; }
  const std::string& key() const override { return key_; }
  std::int64_t boot_count() const override { return boot_count_; }

  absl::Status write_together(const std::function<void()>& body) override;
  absl::Status add_job(JobRecord& job) override;
  absl::Status update_job(const JobRecord& job) override;
  absl::Status remove_job(const std::string& job_id) override;
  absl::StatusOr<std::vector<JobRecord>> jobs() const override;
  absl::StatusOr<std::optional<std::int32_t>> removed_state(
      const std::string& job_id) const override;

  absl::Status commit(std::vector<Commit>& group) override;
  absl::Status for_each_unit(const std::string& job_id,
                             const std::function<void(const UnitRecord&)>& visit) const override;
  absl::StatusOr<std::string> read_block(const std::string& job_id,
                                         const UnitRecord& record) const override;
  absl::Status rewrite_job(const JobRecord& job,
                           const std::vector<contract::Unit>& dropped) override;
  absl::Status drop_units(const std::string& job_id,
                          const std::vector<contract::Unit>& units) override;
  absl::Status end_audits(const std::string& job_id,
                          const std::vector<contract::Unit>& units) override;

  absl::StatusOr<std::string> output_folder(const std::string& job_id) override;
  absl::Status finish_frame(const std::string& job_id, const FrameRecord& frame) override;
  std::int64_t max_row_image_bytes() const override { return options_.row_image_bytes; }
  absl::Status finish_small_frame(const std::string& job_id, const FrameRecord& frame,
                                  const std::string& image) override;
  absl::Status update_statistics(const std::string& job_id, std::int32_t frame,
                                 const std::string& statistics_json) override;
  absl::StatusOr<std::optional<std::string>> row_image(const std::string& job_id,
                                                       std::int32_t frame) const override;
  absl::StatusOr<std::vector<FrameRecord>> frames(const std::string& job_id) const override;
  absl::Status close_job(const std::string& job_id) override;
  absl::StatusOr<std::vector<UnitTotals>> totals(const std::string& job_id) const override;

  AssetStore& assets() override { return *assets_; }
  const AssetStore& assets() const override { return *assets_; }

  WorkerStore& workers() override { return *workers_; }
  const WorkerStore& workers() const override { return *workers_; }
  EventStore& events() override { return *events_; }
  const EventStore& events() const override { return *events_; }
  const UsageStore& usage() const override { return *usage_; }
  absl::Status save_settings(SettingKind kind, const Settings& settings) override;
  absl::StatusOr<Settings> settings(SettingKind kind) const override;

  std::int64_t free_bytes() const override;
  std::int64_t used_bytes() const override;

 private:
  /// Fields of a job's row that the writing functions need.
  struct JobRow {
    std::int64_t sequence = 0;
    std::int64_t next_segment = 0;  // unused, and above every released segment
  };

  /// The image of a finished frame.
  struct Image {
    std::string_view row;         // without a file
    std::string path;             // of the file, or of one that the row replaces
    std::int64_t file_bytes = 0;  // 0: it is a row
  };

  DiskStore(std::string folder, Filesystem& filesystem, StoreOptions options);
  absl::Status make_folders();
  absl::Status start();
  absl::Status clean_up();
  absl::Status clean_outputs();
  void remove_links();
  void set_up_ballast();
  /// Writes rows; on a full disk once more without the ballast, with others of the same
  /// write_together().
  absl::Status write_at_any_cost(const std::function<absl::Status(Database&)>& body);
  absl::StatusOr<JobRow> find_job(const std::string& job_id) const;
  bool fits_rows(const std::string& job_id, const std::vector<Commit*>& units) const;
  absl::Status append_job(const std::string& job_id, const JobRow& job,
                          const std::vector<Commit*>& units);
  static absl::Status update_row(Database& rows, const JobRecord& job);
  static absl::Status delete_units(Database& rows, std::int64_t job,
                                   const std::vector<contract::Unit>& units);
  static absl::Status add_up_units(Database& rows, std::int64_t job);
  static absl::Status insert_blocks(Database& rows, std::int64_t job,
                                    const std::vector<Commit*>& units);
  static absl::Status insert_units(Database& rows, const JobRow& job, std::int64_t hour,
                                   const std::vector<Commit*>& units);
  absl::StatusOr<std::string> read_row_block(std::int64_t id) const;
  absl::StatusOr<std::string> output_path(const std::string& job_id,
                                          const FrameRecord& frame) const;
  absl::StatusOr<std::int64_t> sync_output(const std::string& job_id, const std::string& path);
  absl::Status write_frame(std::int64_t job, const FrameRecord& frame, const Image& image);
  absl::StatusOr<std::int64_t> sum_bytes(std::string_view sql, std::int64_t job) const;

  StoreOptions options_;
  std::string folder_;
  DurableFiles files_;
  Ballast ballast_;        // for removing jobs
  Ballast start_ballast_;  // for starting: results fill what that leaves before a job is removed
  std::unique_ptr<FileLock> lock_;
  std::unique_ptr<Journal> journal_;
  Segments segments_;
  std::unique_ptr<EventRows> events_;
  std::unique_ptr<UsageRows> usage_;
  std::unique_ptr<DiskAssets> assets_;
  std::unique_ptr<WorkerRows> workers_;
  std::string id_, key_;
  std::int64_t boot_count_ = 0;
  std::atomic<std::int64_t> content_bytes_ = 0;  // segments and finished frames
  bool at_any_cost_ = false;                     // write_together() includes a write_at_any_cost()
  // Bytes of blocks that this process has committed, by jobs that are not closed; writer only.
  std::map<std::string, std::int64_t> job_bytes_;
};

}  // namespace tessera::server
