#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "worker/ipc/descriptor.h"

namespace tessera::agent {

/// Directory of scene files named by their SHA-256, shared by the workers of a host.
///
/// A file becomes visible only after its bytes are verified (temporary file, fsync, rename, fsync
/// of the directory). The least recently used files are removed first. Open descriptors outlive
/// their names, so files need no pinning. Thread-safe.
class AssetCache {
 public:
  /// Opens `folder`, creating it if missing, and trims it. Errors: FailedPrecondition, the
  /// directory cannot be created.
  static absl::StatusOr<std::unique_ptr<AssetCache>> open(const std::string& folder,
                                                          std::int64_t limit_bytes);

  /// Sends an asset's bytes to `write` in order.
  using Source =
      std::function<absl::Status(const std::function<absl::Status(std::string_view)>& write)>;

  /// Opens an asset for reading, from the directory (verified once per process) or else from
  /// `download`. Errors: DataLoss, the downloaded bytes do not match the digest;
  /// FailedPrecondition, the directory is not writable; those of `download`.
  absl::StatusOr<Descriptor> get(const contract::Digest& digest, std::int64_t size_bytes,
                                 const Source& download);

  /// Creates an unnamed file for reading and writing, which is deleted with its last descriptor.
  /// Errors: FailedPrecondition, the directory is not writable.
  absl::StatusOr<Descriptor> scratch();

  /// Removes partial files of killed workers, and the least recently used files until the rest fits
  /// the limit.
  void trim();

 private:
  AssetCache(std::string folder, std::int64_t limit_bytes)
      : folder_(std::move(folder)), limit_bytes_(limit_bytes) {}

  std::string path_of(const contract::Digest& digest) const;
  std::optional<Descriptor> open_verified(const contract::Digest& digest, std::int64_t size_bytes);
  absl::StatusOr<Descriptor> fill(const contract::Digest& digest, std::int64_t size_bytes,
                                  const Source& download);
  void note_verified(const contract::Digest& digest);

  const std::string folder_;
  const std::int64_t limit_bytes_;
  std::mutex mutex_;  // guards what follows
  std::set<contract::Digest> verified_;
};

}  // namespace tessera::agent
