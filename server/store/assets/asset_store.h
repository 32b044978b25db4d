#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "server/store/files/filesystem.h"

namespace tessera::server {

/// The bytes of an asset, which stay readable when the asset is deleted. Any thread.
class AssetReader {
 public:
  AssetReader(std::string bytes, std::int64_t stored_us)
      : bytes_(std::move(bytes)), stored_us_(stored_us) {}
  AssetReader(std::unique_ptr<const File> file, std::int64_t stored_us)
      : file_(std::move(file)), stored_us_(stored_us) {}

  std::int64_t size() const {
    return file_ != nullptr ? file_->size() : static_cast<std::int64_t>(bytes_.size());
  }
  /// Time at which the asset was last stored; see AssetStore::drop().
  std::int64_t stored_us() const { return stored_us_; }
  /// Fills `out` from `offset` on. Errors: OutOfRange, the asset is too short; those of File.
  absl::Status read_at(std::int64_t offset, std::span<char> out) const;

 private:
  std::string bytes_;                 // of an asset in a row
  std::unique_ptr<const File> file_;  // null: the asset is in a row
  std::int64_t stored_us_ = 0;
};

/// Assets by digest. Small ones are rows, so that many uploads share a sync; others are files.
/// Threads: as Store.
class AssetStore {
 public:
  virtual ~AssetStore() = default;

  /// Whether the asset is complete: one whose bytes are lost is uploaded again. Any thread.
  virtual bool has(const contract::Digest& digest) const = 0;
  /// Returns a reader of an asset, in a row or a file. Any thread. Errors: NotFound.
  virtual absl::StatusOr<AssetReader> open(const contract::Digest& digest) const = 0;

  /// Size up to which an asset is a row. Any thread.
  virtual std::int64_t max_row_bytes() const = 0;
  /// Adds a verified small asset as a row. collect() spares it for an hour.
  virtual absl::Status add(const contract::Digest& digest, std::string_view bytes) = 0;

  /// Returns a file to write a large upload to; visible only after publish(). Any thread.
  virtual absl::StatusOr<std::string> new_upload_path() = 0;
  /// Publishes a complete, verified upload: fsync, rename, fsync of the directory. collect() spares
  /// it for an hour. The upload's file no longer exists afterwards. Not within write_together().
  virtual absl::Status publish(const std::string& upload_path, const contract::Digest& digest) = 0;

  /// Deletes an asset whose bytes are damaged, so that it is uploaded again. Does nothing if it has
  /// been stored after `stored_us`, the time that the reader of the damaged bytes has. Not within
  /// write_together().
  virtual absl::Status drop(const contract::Digest& digest, std::int64_t stored_us) = 0;
  /// Records that a removed job used these assets until now.
  virtual absl::Status release(const std::vector<contract::Digest>& digests) = 0;
  /// Deletes least recently used assets (by release, else upload) until the rest take at most
  /// `quota_bytes`. Spares assets uploaded within the hour before `now_us` and those in `named`,
  /// which jobs refer to. Not within write_together().
  virtual absl::Status collect(std::int64_t now_us, std::int64_t quota_bytes,
                               const std::vector<contract::Digest>& named) = 0;

  /// Returns the size of all published assets. Any thread.
  virtual std::int64_t used_bytes() const = 0;
};

}  // namespace tessera::server
