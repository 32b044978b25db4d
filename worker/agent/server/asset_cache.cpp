#include "worker/agent/server/asset_cache.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"

namespace tessera::agent {
namespace {

constexpr std::size_t kReadBytes = 1 << 20;
constexpr char kPartExtension[] = ".part";  // of files being written

absl::Status disk_error(const std::string& path) {
  return absl::FailedPreconditionError(absl::StrCat(path, ": ", std::strerror(errno)));
}

bool has_digest(int fd, const contract::Digest& digest) {
  contract::Hasher hasher;
  std::vector<char> buffer(kReadBytes);
  off_t offset = 0;
  while (true) {
    const ssize_t count = ::pread(fd, buffer.data(), buffer.size(), offset);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    if (count == 0) return hasher.finish() == digest;
    hasher.update(std::string_view(buffer.data(), static_cast<std::size_t>(count)));
    offset += count;
  }
}

absl::Status write_all(int fd, std::string_view bytes, const std::string& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return disk_error(path);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status sync_folder(const std::string& path) {
  const Descriptor folder(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder || ::fsync(folder.get()) != 0) return disk_error(path);
  return absl::OkStatus();
}

/// Creates a file PATH.XXXXXX.part, stores its name in `name` and locks it while it is open: the
/// kernel releases the lock of a killed worker.
Descriptor create_part(const std::string& path, std::string& name) {
  while (true) {
    name = absl::StrCat(path, ".XXXXXX", kPartExtension);
    Descriptor file(
        ::mkostemps(name.data(), static_cast<int>(sizeof kPartExtension - 1), O_CLOEXEC));
    if (!file) return file;
    ::flock(file.get(), LOCK_EX);
    struct stat info {};  // another worker may have removed it before it was locked
    if (::fstat(file.get(), &info) == 0 && info.st_nlink > 0) return file;
  }
}

/// Removes a partial file unless a worker is still writing it.
void remove_if_abandoned(const std::string& part) {
  const Descriptor file(::open(part.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
  if (file && ::flock(file.get(), LOCK_EX | LOCK_NB) == 0) ::unlink(part.c_str());
}

}  // namespace

absl::StatusOr<std::unique_ptr<AssetCache>> AssetCache::open(const std::string& folder,
                                                             std::int64_t limit_bytes) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return absl::FailedPreconditionError(
        absl::StrCat("cache directory ", folder, ": ", error.message()));
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) {
    return disk_error(absl::StrCat("cache directory ", folder));
  }
  std::unique_ptr<AssetCache> cache(new AssetCache(folder, limit_bytes));
  cache->trim();
  return cache;
}

std::string AssetCache::path_of(const contract::Digest& digest) const {
  return absl::StrCat(folder_, "/", digest.hex());
}

absl::StatusOr<Descriptor> AssetCache::get(const contract::Digest& digest, std::int64_t size_bytes,
                                           const Source& download) {
  if (auto present = open_verified(digest, size_bytes)) return *std::move(present);
  auto fetched = fill(digest, size_bytes, download);
  if (fetched.ok()) trim();
  return fetched;
}

std::optional<Descriptor> AssetCache::open_verified(const contract::Digest& digest,
                                                    std::int64_t size_bytes) {
  Descriptor file(::open(path_of(digest).c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
  if (!file) return std::nullopt;
  struct stat info {};
  if (::fstat(file.get(), &info) != 0 || info.st_size != size_bytes) return std::nullopt;
  bool known = false;
  {
    const std::lock_guard lock(mutex_);
    known = verified_.contains(digest);
  }
  if (!known && !has_digest(file.get(), digest)) return std::nullopt;  // fill() replaces it
  note_verified(digest);
  ::futimens(file.get(), nullptr);  // marks it as used now
  return file;
}

absl::StatusOr<Descriptor> AssetCache::fill(const contract::Digest& digest, std::int64_t size_bytes,
                                            const Source& download) {
  std::string part;
  Descriptor file = create_part(path_of(digest), part);
  if (!file) return disk_error(part);
  contract::Hasher hasher;
  std::int64_t received = 0;
  absl::Status status = download([&](std::string_view bytes) {
    received += static_cast<std::int64_t>(bytes.size());
    if (received > size_bytes) return absl::DataLossError("download exceeds the size of the asset");
    hasher.update(bytes);
    return write_all(file.get(), bytes, part);
  });
  if (status.ok() && (received != size_bytes || hasher.finish() != digest)) {
    status = absl::DataLossError(
        absl::StrCat("asset ", digest.hex(), ": downloaded bytes do not match the digest"));
  }
  if (status.ok() && ::fsync(file.get()) != 0) status = disk_error(part);
  if (status.ok() && ::rename(part.c_str(), path_of(digest).c_str()) != 0) {
    status = disk_error(part);
  }
  if (!status.ok()) {
    ::unlink(part.c_str());
    return status;
  }
  if (status = sync_folder(folder_); !status.ok()) return status;
  note_verified(digest);
  return file;
}

absl::StatusOr<Descriptor> AssetCache::scratch() {
  Descriptor file(::open(folder_.c_str(), O_RDWR | O_TMPFILE | O_CLOEXEC, 0600));
  if (!file) {  // not every file system supports O_TMPFILE
    std::string name = folder_ + "/scratch.XXXXXX";
    file = Descriptor(::mkostemp(name.data(), O_CLOEXEC));
    if (file) ::unlink(name.c_str());
  }
  if (!file) return disk_error(folder_);
  return file;
}

void AssetCache::note_verified(const contract::Digest& digest) {
  const std::lock_guard lock(mutex_);
  verified_.insert(digest);
}

void AssetCache::trim() {
  namespace fs = std::filesystem;
  struct CachedFile {
    fs::file_time_type used;
    fs::path path;
    std::int64_t size = 0;
  };
  std::vector<CachedFile> files;
  std::int64_t total = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    std::error_code gone;  // another worker may remove files meanwhile
    const auto size = static_cast<std::int64_t>(entry.file_size(gone));
    const fs::file_time_type used = entry.last_write_time(gone);
    if (gone) continue;
    if (entry.path().extension() == kPartExtension) remove_if_abandoned(entry.path());
    if (!entry.path().extension().empty()) continue;
    files.push_back({used, entry.path(), size});
    total += size;
  }
  std::sort(files.begin(), files.end(), [](const CachedFile& a, const CachedFile& b) {
    return std::tie(a.used, a.path) < std::tie(b.used, b.path);
  });
  for (const CachedFile& file : files) {
    if (total <= limit_bytes_) break;
    fs::remove(file.path, error);
    total -= file.size;
  }
}

}  // namespace tessera::agent
