#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/store/files/filesystem.h"
#include "tests/support/disk_model.h"

namespace tessera::testing {

class RecordingVfs;

/// A folder on the real disk that writes down everything done to it, by the store's own file
/// operations and by SQLite, in order. Syncs are written down and not passed on: what they mean is
/// DiskModel's business. A file that was written behind its back (an image by OpenEXR, say) is
/// taken down whole when it is opened here and at each sync, as the earliest moments at which what
/// it holds matters. One thread at a time.
class PowerCutDisk final : public server::Filesystem {
 public:
  /// Records below `root`, which exists; what is there now counts as known.
  explicit PowerCutDisk(std::string root);
  ~PowerCutDisk() override;
  PowerCutDisk(const PowerCutDisk&) = delete;
  PowerCutDisk& operator=(const PowerCutDisk&) = delete;

  const std::vector<DiskEvent>& events() const { return events_; }
  /// Writes an event down; `path` and `target` as the program sees them.
  void record(DiskEvent event);

  absl::Status make_folder(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::File>> open(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::File>> open_existing(const std::string& path) override;
  absl::Status rename(const std::string& from, const std::string& to) override;
  absl::Status remove(const std::string& path) override;
  absl::StatusOr<std::vector<std::string>> list(const std::string& folder) const override;
  absl::Status sync_folder(const std::string& path) override;
  absl::StatusOr<std::unique_ptr<server::FileLock>> lock(const std::string& path) override;
  std::string sqlite_vfs() const override;

 private:
  std::string relative(const std::string& path) const;

  std::string root_;
  server::Filesystem& disk_;
  std::vector<DiskEvent> events_;
  std::map<std::string, bool> is_foreign_;  // by file: written by somebody who does not report it
  std::unique_ptr<RecordingVfs> vfs_;
};

}  // namespace tessera::testing
