#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::server {

/// A file open for appending and reading at any offset.
class File {
 public:
  virtual ~File() = default;
  /// Writes at the end. After an error the end may hold a part of `bytes`.
  virtual absl::Status append(std::string_view bytes) = 0;
  /// Fills `out`. Errors: OutOfRange, the file ends before that.
  virtual absl::Status read_at(std::int64_t offset, std::span<char> out) const = 0;
  /// Makes contents (and length) durable: fdatasync.
  virtual absl::Status sync() = 0;
  virtual std::int64_t size() const = 0;
};

/// Held for as long as the object lives.
class FileLock {
 public:
  virtual ~FileLock() = default;
};

/// The few disk operations the store makes outside SQLite, so that a test can record them and
/// rebuild the disk as a power cut would leave it. Any thread may call them.
///
/// Errors are errno's: NotFound, PermissionDenied, ResourceExhausted when the disk is full, …
class Filesystem {
 public:
  virtual ~Filesystem() = default;
  virtual absl::Status make_folder(const std::string& path) = 0;  // mode 0700; fine if it exists
  virtual absl::StatusOr<std::unique_ptr<File>> open(
      const std::string& path) = 0;  // created if needed, mode 0600
  /// Errors: NotFound, there is no such file.
  virtual absl::StatusOr<std::unique_ptr<File>> open_existing(const std::string& path) = 0;
  virtual absl::Status rename(const std::string& from, const std::string& to) = 0;
  virtual absl::Status remove(const std::string& path) = 0;  // or empty folder; fine if it is gone
  /// Names in a folder, sorted. Errors: NotFound, there is no such folder.
  virtual absl::StatusOr<std::vector<std::string>> list(const std::string& folder) const = 0;
  /// Makes names in a folder durable: fsync of the folder.
  virtual absl::Status sync_folder(const std::string& path) = 0;
  /// Locks a file (flock), made if needed. Errors: FailedPrecondition, another holder has it.
  virtual absl::StatusOr<std::unique_ptr<FileLock>> lock(const std::string& path) = 0;
  /// Name of the SQLite VFS whose files belong to this file system; empty: SQLite's default.
  virtual std::string sqlite_vfs() const { return {}; }
};

/// The machine's disk.
Filesystem& real_filesystem();

}  // namespace tessera::server
