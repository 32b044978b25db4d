#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"
#include "server/store/assets/asset_store.h"
#include "server/store/files/durable_files.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Each asset has a row in the table assets, and its bytes in the table asset_contents or in the
/// file DIRECTORY/ab/cdef…; a file without a row does not count.
class DiskAssets final : public AssetStore {
 public:
  struct Options {
    std::int64_t max_row_bytes = 0;
    std::int64_t boot_count = 0;  // of the store: part of the names of uploads
    std::function<std::int64_t()> now_us;
    std::function<void(const std::string&)> warn;
  };

  DiskAssets(DurableFiles& files, Journal& journal, std::string folder, Options options);

  /// Deletes files without rows and unfinished uploads, and sums up the sizes of the others. Skips
  /// what is no directory of assets, with a warning.
  absl::Status clean_up();

  bool has(const contract::Digest& digest) const override;
  absl::StatusOr<AssetReader> open(const contract::Digest& digest) const override;
  std::int64_t max_row_bytes() const override { return options_.max_row_bytes; }
  absl::Status add(const contract::Digest& digest, std::string_view bytes) override;
  absl::StatusOr<std::string> new_upload_path() override;
  absl::Status publish(const std::string& upload_path, const contract::Digest& digest) override;
  absl::Status drop(const contract::Digest& digest, std::int64_t stored_us) override;
  absl::Status release(const std::vector<contract::Digest>& digests) override;
  absl::Status collect(std::int64_t now_us, std::int64_t quota_bytes,
                       const std::vector<contract::Digest>& named) override;
  std::int64_t used_bytes() const override { return used_bytes_; }

  /// Size of the assets that are files.
  std::int64_t file_bytes() const { return file_bytes_; }

 private:
  /// Sizes of an asset in bytes, from its rows; -1: there is no such row.
  struct Rows {
    std::int64_t asset_bytes = -1, content_bytes = -1;
    bool is_file() const { return asset_bytes >= 0 && content_bytes < 0; }
  };
  struct Victim {
    contract::Digest digest;
    Rows rows;
  };

  static absl::StatusOr<Rows> find(Database& database, const contract::Digest& digest);
  bool is_complete(const Rows& rows, const contract::Digest& digest) const;
  /// Counts an asset that has replaced `before`; bytes -1: it is deleted.
  void count(const Rows& before, const Rows& after);
  std::string path(const contract::Digest& digest) const;
  absl::Status make_visible(const std::string& upload_path, const contract::Digest& digest);
  absl::StatusOr<std::vector<Victim>> find_victims(
      std::int64_t now_us, std::int64_t excess, const std::vector<contract::Digest>& named) const;
  absl::Status erase(const std::vector<Victim>& victims);
  void clean_folder(const std::string& name, const std::set<contract::Digest>& known);

  DurableFiles& files_;
  Journal& journal_;
  const std::string folder_;
  const Options options_;
  std::atomic<std::int64_t> upload_count_ = 0;
  std::atomic<std::int64_t> used_bytes_ = 0, file_bytes_ = 0;
};

}  // namespace tessera::server
