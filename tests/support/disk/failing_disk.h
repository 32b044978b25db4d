#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/store/files/filesystem.h"

namespace tessera::testing {

class RecordingVfs;

/// The real disk with injected failures. One thread at a time.
class FailingDisk final : public server::Filesystem {
 public:
  FailingDisk();
  ~FailingDisk() override;

  /// Appends fail with "no space" once this many more bytes are written; the rest of the append
  /// that meets the limit is lost.
  void fail_write_after(std::int64_t bytes);
  /// Every sync of a file or folder outside SQLite fails with an I/O error.
  void fail_syncs();
  /// Folders cannot be opened for their sync, as when the process is out of descriptors.
  void fail_opening_folders() { folders_fail_ = true; }
  /// Every sync by SQLite of the file of this name fails with an I/O error.
  void fail_sqlite_syncs(const std::string& name);
  /// Every write by SQLite to the file of this name fails for want of space.
  void fail_sqlite_writes(const std::string& name);
  /// Files whose path contains `part` cannot be removed.
  void fail_removing(const std::string& part) { unremovable_ = part; }
  /// Stops all failures when a file of this name is removed, as when its space is needed.
  void recover_when_removed(const std::string& name) { ballast_ = name; }
  /// `act` is called with the path of each file that open_existing() is to open.
  void before_open(std::function<void(const std::string& path)> act) {
    before_open_ = std::move(act);
  }
  /// Stops all failures.
  void recover();
  /// Number of syncs outside SQLite requested after a failed one.
  int syncs_after_failure() const { return syncs_after_failure_; }

  /// Number of bytes that an append of `bytes` may write now.
  std::int64_t grant_bytes(std::int64_t bytes);
  absl::Status grant_sync();

  absl::Status make_folder(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::File>> open(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::File>> open_existing(const std::string& path) override;
  absl::Status link(const std::string& from, const std::string& to) override;
  absl::Status reserve(const std::string& path, std::int64_t bytes) override;
  absl::StatusOr<std::int64_t> size_of(const std::string& path) const override;
  absl::Status rename(const std::string& from, const std::string& to) override;
  absl::Status remove(const std::string& path) override;
  absl::StatusOr<std::vector<std::string>> list(const std::string& folder) const override;
  absl::Status sync_folder(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::FileLock>> lock(const std::string& path) override;
  std::string sqlite_vfs() const override;

 private:
  server::Filesystem& disk_;
  std::unique_ptr<RecordingVfs> vfs_;
  std::int64_t bytes_left_;
  bool syncs_fail_ = false;
  bool has_failed_ = false;
  bool folders_fail_ = false;
  std::string ballast_, unremovable_;
  std::function<void(const std::string& path)> before_open_;
  int syncs_after_failure_ = 0;
  std::string failing_sqlite_file_, full_sqlite_file_;
};

}  // namespace tessera::testing
