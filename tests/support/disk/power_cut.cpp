#include "tests/support/disk/power_cut.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <utility>

#include "tests/support/disk/recording_vfs.h"

namespace tessera::testing {
namespace {

using Kind = DiskEvent::Kind;

class RecordedFile final : public server::File {
 public:
  /// `is_foreign`: written by code that does not report its writes.
  RecordedFile(PowerCutDisk& disk, std::string path, std::unique_ptr<server::File> file,
               bool is_foreign)
      : disk_(disk), path_(std::move(path)), file_(std::move(file)), is_foreign_(is_foreign) {}

  absl::Status append(std::string_view bytes) override {
    if (!disk_.grant_write()) return absl::ResourceExhaustedError("the disk is full");
    disk_.record({Kind::write, path_, "", file_->size(), std::string(bytes)});
    return file_->append(bytes);
  }
  absl::Status read_at(std::int64_t offset, std::span<char> out) const override {
    return file_->read_at(offset, out);
  }
  absl::Status sync() override {
    if (is_foreign_) {
      std::string bytes(static_cast<std::size_t>(file_->size()), '\0');
      if (absl::Status read = file_->read_at(0, bytes); !read.ok()) return read;
      disk_.record({Kind::truncate, path_, "", 0, ""});
      disk_.record({Kind::write, path_, "", 0, std::move(bytes)});
    }
    disk_.record({Kind::sync_file, path_, "", 0, ""});
    return absl::OkStatus();
  }
  std::int64_t size() const override { return file_->size(); }

 private:
  PowerCutDisk& disk_;
  std::string path_;
  std::unique_ptr<server::File> file_;
  bool is_foreign_;
};

bool exists(const std::string& path) {
  return ::access(path.c_str(), F_OK) == 0;
}

}  // namespace

PowerCutDisk::PowerCutDisk(std::string root)
    : root_(std::move(root)),
      disk_(server::real_filesystem()),
      vfs_(std::make_unique<RecordingVfs>([this](DiskEvent event) {
        if (event.kind == Kind::write && !grant_write()) return false;
        record(std::move(event));
        return true;
      })) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root_)) {
    if (!entry.is_regular_file()) continue;
    const std::string path = relative(entry.path().string());
    is_foreign_[path] = path.find("/outputs/") != std::string::npos;
  }
}

PowerCutDisk::~PowerCutDisk() = default;

bool PowerCutDisk::grant_write() {
  is_full_ = is_full_ || writes_left_ == 0;
  if (writes_left_ != kUnlimited && writes_left_ > 0) --writes_left_;
  refused_count_ += is_full_ ? 1 : 0;
  return !is_full_;
}

std::string PowerCutDisk::sqlite_vfs() const {
  return vfs_->name();
}

std::string PowerCutDisk::relative(const std::string& path) const {
  if (path.compare(0, root_.size(), root_) != 0) std::abort();  // outside the disk
  return path.size() == root_.size() ? "" : path.substr(root_.size() + 1);
}

void PowerCutDisk::record(DiskEvent event) {
  event.path = relative(event.path);
  if (event.kind == Kind::create) is_foreign_[event.path] = false;
  if (event.kind == Kind::remove) is_foreign_.erase(event.path);
  if (event.kind == Kind::rename) {
    event.target = relative(event.target);
    is_foreign_[event.target] = is_foreign_[event.path];
    is_foreign_.erase(event.path);
  }
  events_.push_back(std::move(event));
}

absl::Status PowerCutDisk::make_folder(const std::string& path) {
  if (!exists(path)) record({Kind::make_folder, path, "", 0, ""});
  return disk_.make_folder(path);
}

absl::StatusOr<std::unique_ptr<server::File>> PowerCutDisk::open(const std::string& path) {
  if (!exists(path)) record({Kind::create, path, "", 0, ""});
  auto file = disk_.open(path);
  if (!file.ok()) return file;
  return std::make_unique<RecordedFile>(*this, path, *std::move(file), false);
}

absl::StatusOr<std::unique_ptr<server::File>> PowerCutDisk::open_existing(const std::string& path) {
  auto file = disk_.open_existing(path);
  if (!file.ok()) return file;
  const std::string name = relative(path);
  if (is_foreign_.count(name) == 0) {
    record({Kind::create, path, "", 0, ""});
    is_foreign_[name] = true;
  }
  return std::make_unique<RecordedFile>(*this, path, *std::move(file), is_foreign_[name]);
}

absl::StatusOr<std::int64_t> PowerCutDisk::size_of(const std::string& path) const {
  return disk_.size_of(path);
}

absl::Status PowerCutDisk::rename(const std::string& from, const std::string& to) {
  record({Kind::rename, from, to, 0, ""});
  return disk_.rename(from, to);
}

absl::Status PowerCutDisk::remove(const std::string& path) {
  if (exists(path)) record({Kind::remove, path, "", 0, ""});
  return disk_.remove(path);
}

absl::StatusOr<std::vector<std::string>> PowerCutDisk::list(const std::string& folder) const {
  return disk_.list(folder);
}

absl::Status PowerCutDisk::sync_folder(const std::string& path) {
  record({Kind::sync_folder, path, "", 0, ""});
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<server::FileLock>> PowerCutDisk::lock(const std::string& path) {
  if (!exists(path)) record({Kind::create, path, "", 0, ""});
  return disk_.lock(path);
}

}  // namespace tessera::testing
