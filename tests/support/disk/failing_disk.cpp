#include "tests/support/disk/failing_disk.h"

#include <limits>
#include <utility>

#include "absl/status/status.h"
#include "tests/support/disk/recording_vfs.h"

namespace tessera::testing {
namespace {

constexpr std::int64_t kUnlimited = std::numeric_limits<std::int64_t>::max();

class FailingFile final : public server::File {
 public:
  FailingFile(FailingDisk& disk, std::unique_ptr<server::File> file)
      : disk_(disk), file_(std::move(file)) {}

  absl::Status append(std::string_view bytes) override {
    const std::int64_t granted = disk_.grant_bytes(static_cast<std::int64_t>(bytes.size()));
    absl::Status written = file_->append(bytes.substr(0, static_cast<std::size_t>(granted)));
    if (!written.ok() || granted == static_cast<std::int64_t>(bytes.size())) return written;
    return absl::ResourceExhaustedError("no space left on the failing disk");
  }
  absl::Status read_at(std::int64_t offset, std::span<char> out) const override {
    return file_->read_at(offset, out);
  }
  absl::Status sync() override { return disk_.grant_sync(); }
  std::int64_t size() const override { return file_->size(); }

 private:
  FailingDisk& disk_;
  std::unique_ptr<server::File> file_;
};

}  // namespace

FailingDisk::FailingDisk()
    : disk_(server::real_filesystem()),
      vfs_(std::make_unique<RecordingVfs>([this](const DiskEvent& event) {
        const std::string name = event.path.substr(event.path.find_last_of('/') + 1);
        if (event.kind == DiskEvent::Kind::sync_file) return name != failing_sqlite_file_;
        return event.kind != DiskEvent::Kind::write || name != full_sqlite_file_;
      })),
      bytes_left_(kUnlimited) {}

FailingDisk::~FailingDisk() = default;

void FailingDisk::fail_write_after(std::int64_t bytes) {
  bytes_left_ = bytes;
}

void FailingDisk::fail_syncs() {
  syncs_fail_ = true;
}

void FailingDisk::fail_sqlite_syncs(const std::string& name) {
  failing_sqlite_file_ = name;
}

void FailingDisk::fail_sqlite_writes(const std::string& name) {
  full_sqlite_file_ = name;
}

void FailingDisk::recover() {
  bytes_left_ = kUnlimited;
  syncs_fail_ = false;
  folders_fail_ = false;
  ballast_.clear();
  unremovable_.clear();
  failing_sqlite_file_.clear();
  full_sqlite_file_.clear();
}

std::int64_t FailingDisk::grant_bytes(std::int64_t bytes) {
  const std::int64_t granted = bytes < bytes_left_ ? bytes : bytes_left_;
  if (bytes_left_ != kUnlimited) bytes_left_ -= granted;
  return granted;
}

absl::Status FailingDisk::grant_sync() {
  if (has_failed_) ++syncs_after_failure_;
  if (!syncs_fail_) return absl::OkStatus();
  has_failed_ = true;
  return absl::UnknownError("the failing disk cannot sync");
}

absl::Status FailingDisk::make_folder(const std::string& path) {
  return disk_.make_folder(path);
}

absl::StatusOr<std::unique_ptr<server::File>> FailingDisk::open(const std::string& path) {
  auto file = disk_.open(path);
  if (!file.ok()) return file;
  return std::make_unique<FailingFile>(*this, *std::move(file));
}

absl::Status FailingDisk::link(const std::string& from, const std::string& to) {
  return disk_.link(from, to);
}

absl::StatusOr<std::unique_ptr<server::File>> FailingDisk::open_existing(const std::string& path) {
  if (before_open_) before_open_(path);
  auto file = disk_.open_existing(path);
  if (!file.ok()) return file;
  return std::make_unique<FailingFile>(*this, *std::move(file));
}

absl::StatusOr<std::int64_t> FailingDisk::size_of(const std::string& path) const {
  return disk_.size_of(path);
}

absl::Status FailingDisk::rename(const std::string& from, const std::string& to) {
  return disk_.rename(from, to);
}

absl::Status FailingDisk::reserve(const std::string& path, std::int64_t bytes) {
  return disk_.reserve(path, bytes);
}

absl::Status FailingDisk::remove(const std::string& path) {
  if (!ballast_.empty() && path.substr(path.find_last_of('/') + 1) == ballast_) recover();
  if (!unremovable_.empty() && path.find(unremovable_) != std::string::npos) {
    return absl::PermissionDeniedError("the failing disk cannot remove " + path);
  }
  return disk_.remove(path);
}

absl::StatusOr<std::vector<std::string>> FailingDisk::list(const std::string& folder) const {
  return disk_.list(folder);
}

absl::Status FailingDisk::sync_folder(const std::string& path) {
  if (folders_fail_) return absl::UnavailableError("no file descriptor is free: " + path);
  const absl::Status synced = grant_sync();
  return synced.ok() ? synced : absl::DataLossError(synced.message());
}

absl::StatusOr<std::unique_ptr<server::FileLock>> FailingDisk::lock(const std::string& path) {
  return disk_.lock(path);
}

std::string FailingDisk::sqlite_vfs() const {
  return vfs_->name();
}

}  // namespace tessera::testing
