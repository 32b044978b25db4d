#pragma once

#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/store/files/filesystem.h"
#include "tests/support/disk/disk_model.h"

namespace tessera::testing {

class RecordingVfs;

/// Records, in order, all operations on a folder of the real disk by the store's file operations
/// and by SQLite. Syncs are recorded but not executed; DiskModel interprets them. A file written by
/// other code (an image by OpenEXR, for instance) is recorded whole when it is opened here and at
/// each sync, the earliest moments at which its contents matter. One thread at a time.
class PowerCutDisk final : public server::Filesystem {
 public:
  /// Records operations below the existing folder `root`, whose present contents are known. Files
  /// in a folder `outputs` are written by other code.
  explicit PowerCutDisk(std::string root);
  ~PowerCutDisk() override;
  PowerCutDisk(const PowerCutDisk&) = delete;
  PowerCutDisk& operator=(const PowerCutDisk&) = delete;

  const std::vector<DiskEvent>& events() const { return events_; }
  /// While it is full, writes fail for want of space; those by other code do not.
  void set_full(bool is_full) {
    is_full_ = is_full;
    writes_left_ = kUnlimited;
  }
  /// The disk is full after so many more writes.
  void fill_after(int writes) { writes_left_ = writes; }
  /// Number of writes refused since the last call.
  int refused_count() { return std::exchange(refused_count_, 0); }
  /// Whether a write may be done now; counts it if not.
  bool grant_write();
  /// Records an event; `path` and `target` as the program sees them.
  void record(DiskEvent event);

  absl::Status make_folder(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::File>> open(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::File>> open_existing(const std::string& path) override;
  absl::StatusOr<std::int64_t> size_of(const std::string& path) const override;
  absl::Status rename(const std::string& from, const std::string& to) override;
  absl::Status remove(const std::string& path) override;
  absl::StatusOr<std::vector<std::string>> list(const std::string& folder) const override;
  absl::Status sync_folder(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::FileLock>> lock(const std::string& path) override;
  std::string sqlite_vfs() const override;

 private:
  static constexpr int kUnlimited = std::numeric_limits<int>::max();

  std::string relative(const std::string& path) const;

  std::string root_;
  server::Filesystem& disk_;
  std::vector<DiskEvent> events_;
  bool is_full_ = false;
  int refused_count_ = 0;
  int writes_left_ = kUnlimited;
  std::map<std::string, bool> is_foreign_;  // by file: its writes are not reported
  std::unique_ptr<RecordingVfs> vfs_;
};

}  // namespace tessera::testing
