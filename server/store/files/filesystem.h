#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::server {

/// A file open for appending and for reading at any offset.
class File {
 public:
  virtual ~File() = default;
  /// Writes at the end. After an error the file may end with a part of `bytes`.
  virtual absl::Status append(std::string_view bytes) = 0;
  /// Fills `out`. Errors: OutOfRange, the file is too short.
  virtual absl::Status read_at(std::int64_t offset, std::span<char> out) const = 0;
  /// Makes contents and length durable (fdatasync).
  virtual absl::Status sync() = 0;
  virtual std::int64_t size() const = 0;
};

/// Holds a file lock until it is destroyed.
class FileLock {
 public:
  virtual ~FileLock() = default;
};

/// The store's disk operations outside SQLite, so that tests can record them and reconstruct the
/// disk after a power cut. Thread-safe.
///
/// Errors are those of errno: NotFound, PermissionDenied, ResourceExhausted when the disk is full,
/// and so on; Unavailable when no file descriptor is free.
class Filesystem {
 public:
  virtual ~Filesystem() = default;
  /// Creates a directory of mode 0700; succeeds if it exists.
  virtual absl::Status make_folder(const std::string& path) = 0;
  /// Opens a file, created with mode 0600 if missing.
  virtual absl::StatusOr<std::unique_ptr<File>> open(const std::string& path) = 0;
  /// Errors: NotFound, there is no such file.
  virtual absl::StatusOr<std::unique_ptr<File>> open_existing(const std::string& path) = 0;
  /// Returns the size of a file. Errors: NotFound.
  virtual absl::StatusOr<std::int64_t> size_of(const std::string& path) const = 0;
  /// Gives a file a second name (a hard link). Errors: Unimplemented, or any other: the file system
  /// does not support it, or `to` is on another one; AlreadyExists; NotFound.
  virtual absl::Status link(const std::string& /*from*/, const std::string& /*to*/) {
    return absl::UnimplementedError("no hard links");
  }
  /// Creates a file that occupies `bytes` of disk, if four times as many are free.
  virtual absl::Status reserve(const std::string& /*path*/, std::int64_t /*bytes*/) {
    return absl::UnimplementedError("no reservations");
  }
  virtual absl::Status rename(const std::string& from, const std::string& to) = 0;
  /// Deletes a file or an empty directory; succeeds if there is none.
  virtual absl::Status remove(const std::string& path) = 0;
  /// Returns the names in a directory, sorted. Errors: NotFound.
  virtual absl::StatusOr<std::vector<std::string>> list(const std::string& folder) const = 0;
  /// Makes the names in a directory durable (fsync). Errors: DataLoss, the sync failed; others, the
  /// directory could not be opened, and nothing is lost.
  virtual absl::Status sync_folder(const std::string& path) = 0;
  /// Locks a file (flock), created if missing. Errors: FailedPrecondition, another process holds
  /// the lock.
  virtual absl::StatusOr<std::unique_ptr<FileLock>> lock(const std::string& path) = 0;
  /// Name of the SQLite VFS for this file system; empty: SQLite's default.
  virtual std::string sqlite_vfs() const { return {}; }
};

/// Returns the error of a write to `path` that found no space: ResourceExhausted, for users.
/// `doing`: the operation.
absl::Status disk_full(const std::string& path, std::string_view doing);

/// The operating system's file system.
Filesystem& real_filesystem();

}  // namespace tessera::server
