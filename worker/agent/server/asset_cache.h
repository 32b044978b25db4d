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

/// A folder of scene files named by their SHA-256, shared by the workers of a host.
///
/// A file is visible only after its bytes have been verified (temporary file, fsync, rename, folder
/// fsync). The least recently used go first; descriptors that are open outlive their names, so
/// nothing needs a pin. Any thread.
class AssetCache {
 public:
  /// Makes `folder` if need be, and trims it. Errors: FailedPrecondition naming the folder.
  static absl::StatusOr<std::unique_ptr<AssetCache>> open(const std::string& folder,
                                                          std::int64_t limit_bytes);

  /// Sends an asset's bytes to `write` in order.
  using Source =
      std::function<absl::Status(const std::function<absl::Status(std::string_view)>& write)>;

  /// The asset, open for reading: from the folder (verified once by this process), else from
  /// `download`. Errors: DataLoss, the bytes that came do not match; FailedPrecondition, the folder
  /// cannot be written; those of `download`.
  absl::StatusOr<Descriptor> get(const contract::Digest& digest, std::int64_t size_bytes,
                                 const Source& download);

  /// A new file without a name, for reading and writing: it goes when it is closed everywhere.
  /// Errors: FailedPrecondition, the folder cannot be written.
  absl::StatusOr<Descriptor> scratch();

  /// Removes what killed workers left half written, and the least recently used files until the
  /// rest fit the limit.
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
