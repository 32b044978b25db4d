#include "server/store/files/filesystem.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

absl::Status errno_status(const char* what, const std::string& path) {
  if (errno == ENOSPC || errno == EDQUOT) return disk_full(path, what);
  // absl maps these two to ResourceExhausted, which here means that the disk is full.
  if (errno == EMFILE || errno == ENFILE) {
    return absl::UnavailableError(absl::StrCat(what, " ", path, ": no file descriptor is free"));
  }
  return absl::ErrnoToStatus(errno, absl::StrCat(what, " ", path));
}

/// Owns a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  Descriptor& operator=(Descriptor&&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

int open_retrying(const std::string& path, int flags, mode_t mode = 0) {
  int fd = -1;
  do {
    fd = ::open(path.c_str(), flags | O_CLOEXEC, mode);
  } while (fd < 0 && errno == EINTR);
  return fd;
}

class DiskFile final : public File {
 public:
  DiskFile(std::string path, Descriptor fd, std::int64_t size)
      : path_(std::move(path)), fd_(std::move(fd)), size_(size) {}

  absl::Status append(std::string_view bytes) override {
    while (!bytes.empty()) {
      const ssize_t written = ::pwrite(fd_.get(), bytes.data(), bytes.size(), size_);
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) return errno_status("write", path_);
      size_ += written;
      bytes.remove_prefix(static_cast<std::size_t>(written));
    }
    return absl::OkStatus();
  }

  absl::Status read_at(std::int64_t offset, std::span<char> out) const override {
    while (!out.empty()) {
      const ssize_t got = ::pread(fd_.get(), out.data(), out.size(), offset);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return errno_status("read", path_);
      if (got == 0) return absl::OutOfRangeError(absl::StrCat(path_, " ends at ", offset));
      offset += got;
      out = out.subspan(static_cast<std::size_t>(got));
    }
    return absl::OkStatus();
  }

  absl::Status sync() override {
    // Not repeated on EINTR either: the kernel may have marked the pages clean.
    return ::fdatasync(fd_.get()) == 0 ? absl::OkStatus() : errno_status("fdatasync", path_);
  }

  std::int64_t size() const override { return size_; }

 private:
  std::string path_;
  Descriptor fd_;
  std::int64_t size_;
};

class DiskLock final : public FileLock {
 public:
  explicit DiskLock(Descriptor fd) : fd_(std::move(fd)) {}

 private:
  Descriptor fd_;  // closing it unlocks
};

class DiskFilesystem final : public Filesystem {
 public:
  absl::Status make_folder(const std::string& path) override {
    if (::mkdir(path.c_str(), 0700) == 0 || errno == EEXIST) return absl::OkStatus();
    return errno_status("mkdir", path);
  }

  absl::StatusOr<std::unique_ptr<File>> open(const std::string& path) override {
    return open_with(path, O_RDWR | O_CREAT);
  }

  absl::StatusOr<std::unique_ptr<File>> open_existing(const std::string& path) override {
    return open_with(path, O_RDWR);
  }

  absl::StatusOr<std::int64_t> size_of(const std::string& path) const override {
    struct stat info {};
    if (::stat(path.c_str(), &info) != 0) return errno_status("stat", path);
    return info.st_size;
  }

  absl::Status link(const std::string& from, const std::string& to) override {
    if (::link(from.c_str(), to.c_str()) == 0) return absl::OkStatus();
    return errno_status("link", absl::StrCat(from, " to ", to));
  }

  absl::Status reserve(const std::string& path, std::int64_t bytes) override {
    const Descriptor fd(open_retrying(path, O_RDWR | O_CREAT, 0600));
    if (fd.get() < 0) return errno_status("open", path);
    struct statvfs disk {};
    if (::fstatvfs(fd.get(), &disk) != 0) return errno_status("statvfs", path);
    const double free_bytes =
        static_cast<double>(disk.f_bavail) * static_cast<double>(disk.f_frsize);
    if (free_bytes < 4 * static_cast<double>(bytes)) {
      return absl::ResourceExhaustedError(absl::StrCat(path, ": too little space is free"));
    }
    // Not posix_fallocate, which would write where the file system cannot reserve.
    return ::fallocate(fd.get(), 0, 0, bytes) == 0 ? absl::OkStatus()
                                                   : errno_status("fallocate", path);
  }

  absl::Status rename(const std::string& from, const std::string& to) override {
    if (::rename(from.c_str(), to.c_str()) == 0) return absl::OkStatus();
    return errno_status("rename", absl::StrCat(from, " to ", to));
  }

  absl::Status remove(const std::string& path) override {
    if (::remove(path.c_str()) == 0 || errno == ENOENT) return absl::OkStatus();
    return errno_status("remove", path);
  }

  absl::StatusOr<std::vector<std::string>> list(const std::string& folder) const override {
    DIR* const dir = ::opendir(folder.c_str());
    if (dir == nullptr) return errno_status("list", folder);
    std::vector<std::string> names;
    errno = 0;
    while (const dirent* entry = ::readdir(dir)) {
      const std::string name = entry->d_name;
      if (name != "." && name != "..") names.push_back(name);
    }
    absl::Status status = errno == 0 ? absl::OkStatus() : errno_status("list", folder);
    ::closedir(dir);
    if (!status.ok()) return status;
    std::sort(names.begin(), names.end());
    return names;
  }

  absl::Status sync_folder(const std::string& path) override {
    const Descriptor fd(open_retrying(path, O_RDONLY | O_DIRECTORY));
    if (fd.get() < 0) return errno_status("open directory", path);
    if (::fsync(fd.get()) == 0) return absl::OkStatus();
    return absl::DataLossError(errno_status("fsync", path).message());
  }

  absl::StatusOr<std::unique_ptr<FileLock>> lock(const std::string& path) override {
    Descriptor fd(open_retrying(path, O_RDWR | O_CREAT, 0600));
    if (fd.get() < 0) return errno_status("open", path);
    if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
      if (errno != EWOULDBLOCK) return errno_status("lock", path);
      return absl::FailedPreconditionError(absl::StrCat(path, " is held by another process"));
    }
    return std::make_unique<DiskLock>(std::move(fd));
  }

 private:
  static absl::StatusOr<std::unique_ptr<File>> open_with(const std::string& path, int flags) {
    Descriptor fd(open_retrying(path, flags, 0600));
    if (fd.get() < 0) return errno_status("open", path);
    struct stat info {};
    if (::fstat(fd.get(), &info) != 0) return errno_status("stat", path);
    return std::make_unique<DiskFile>(path, std::move(fd), info.st_size);
  }
};

}  // namespace

absl::Status disk_full(const std::string& path, std::string_view doing) {
  return absl::ResourceExhaustedError(
      absl::StrCat("the disk of ", path, " is full (", std::string(doing),
                   "): free space on it, or remove ended jobs with `tessera remove`"));
}

Filesystem& real_filesystem() {
  static DiskFilesystem disk;  // has no state
  return disk;
}

}  // namespace tessera::server
