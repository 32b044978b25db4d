#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "server/store/files/durable_files.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Returns a digest as a value of a row. It points into `digest`.
inline Blob blob_of(const contract::Digest& digest) {
  return {{reinterpret_cast<const char*>(digest.bytes.data()), digest.bytes.size()}};
}

/// Assets by digest: DIRECTORY/ab/cdef…, each with a row; a file without a row does not count.
///
/// One thread may write; any thread may call has(), path() and new_upload_path().
class AssetFiles {
 public:
  AssetFiles(DurableFiles& files, Journal& journal, std::string folder,
             std::function<std::int64_t()> now_us, std::function<void(const std::string&)> warn);

  /// Deletes files without rows and unfinished uploads, and sums up the sizes of the others. Skips
  /// what is no directory of assets, with a warning.
  absl::Status clean_up();

  /// Whether there are a row and a file of the size in the row: a lost file is uploaded again.
  bool has(const contract::Digest& digest) const;
  std::string path(const contract::Digest& digest) const;
  absl::StatusOr<std::string> new_upload_path(std::int64_t boot_count);
  absl::Status publish(const std::string& upload_path, const contract::Digest& digest);
  absl::Status release(const std::vector<contract::Digest>& digests);
  absl::Status collect(std::int64_t now_us, std::int64_t quota_bytes,
                       const std::vector<contract::Digest>& named);

  std::int64_t used_bytes() const { return used_bytes_; }

 private:
  /// Size by the asset's row; -1: there is none.
  absl::StatusOr<std::int64_t> recorded_bytes(const contract::Digest& digest) const;
  absl::Status make_visible(const std::string& upload_path, const contract::Digest& digest);
  void clean_folder(const std::string& name, const std::set<contract::Digest>& known);

  DurableFiles& files_;
  Journal& journal_;
  std::string folder_;
  std::function<std::int64_t()> now_us_;
  std::function<void(const std::string&)> warn_;
  std::atomic<std::int64_t> upload_count_ = 0;
  std::atomic<std::int64_t> used_bytes_ = 0;
};

}  // namespace tessera::server
