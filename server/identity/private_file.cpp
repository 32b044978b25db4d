#include "server/identity/private_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxBytes = 64 << 20;

absl::Status error_at(const std::string& path) {
  return absl::ErrnoToStatus(errno, path);
}

bool write_all(int file, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t put = ::write(file, bytes.data(), bytes.size());
    if (put < 0 && errno != EINTR) return false;
    bytes.remove_prefix(static_cast<std::size_t>(put < 0 ? 0 : put));
  }
  return true;
}

absl::Status sync_folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  const int opened = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (opened < 0) return error_at(folder);
  const bool is_synced = ::fsync(opened) == 0;
  absl::Status status = is_synced ? absl::OkStatus() : error_at(folder);
  ::close(opened);
  return status;
}

absl::Status write_and_close(int file, std::string_view bytes, const std::string& path) {
  if (file < 0) return error_at(path);
  const bool is_durable = write_all(file, bytes) && ::fsync(file) == 0;
  absl::Status status = is_durable ? absl::OkStatus() : error_at(path);
  ::close(file);
  return status;
}

}  // namespace

absl::Status make_private_folder(const std::string& path) {
  if (::mkdir(path.c_str(), 0700) == 0 || errno == EEXIST) return absl::OkStatus();
  return error_at(path);
}

absl::Status write_file(const std::string& path, std::string_view bytes, mode_t mode) {
  const std::string part = absl::StrCat(path, ".part");
  ::unlink(part.c_str());
  const int file = ::open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (absl::Status status = write_and_close(file, bytes, part); !status.ok()) return status;
  if (std::rename(part.c_str(), path.c_str()) != 0) return error_at(path);
  return sync_folder_of(path);
}

absl::Status append_file(const std::string& path, std::string_view bytes) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  return write_and_close(file, bytes, path);
}

absl::StatusOr<std::string> read_file(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return error_at(path);
  std::string bytes;
  std::array<char, 4096> buffer{};
  ssize_t got = 0;
  while ((got = ::read(file, buffer.data(), buffer.size())) > 0 && bytes.size() <= kMaxBytes) {
    bytes.append(buffer.data(), static_cast<std::size_t>(got));
  }
  absl::Status status = got < 0 ? error_at(path) : absl::OkStatus();
  ::close(file);
  if (!status.ok()) return status;
  if (bytes.size() > kMaxBytes) return absl::OutOfRangeError(absl::StrCat(path, ": too large"));
  return bytes;
}

}  // namespace tessera::server
