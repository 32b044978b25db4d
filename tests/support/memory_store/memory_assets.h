#pragma once

#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "server/store/assets/asset_store.h"

namespace tessera::server {

/// Assets in memory; uploads are files in `folder`. Thread-safe.
class MemoryAssets final : public AssetStore {
 public:
  explicit MemoryAssets(std::string folder) : folder_(std::move(folder)) {}

  void set_used_bytes(std::int64_t bytes) { used_bytes_ = bytes; }
  /// Loses an asset, as when its file is deleted.
  void lose(const contract::Digest& digest) {
    const std::lock_guard lock(mutex_);
    contents_.erase(digest);
  }
  /// Number of calls of collect().
  int collection_count() const { return collection_count_; }

  bool has(const contract::Digest& digest) const override {
    const std::lock_guard lock(mutex_);
    return contents_.count(digest) > 0;
  }
  absl::StatusOr<AssetReader> open(const contract::Digest& digest) const override {
    const std::lock_guard lock(mutex_);
    const auto found = contents_.find(digest);
    if (found == contents_.end()) return absl::NotFoundError("no such asset");
    return AssetReader(found->second, store_count_);
  }
  std::int64_t max_row_bytes() const override { return 1000; }
  absl::Status add(const contract::Digest& digest, std::string_view bytes) override {
    const std::lock_guard lock(mutex_);
    contents_[digest] = std::string(bytes);
    ++store_count_;
    return absl::OkStatus();
  }
  absl::StatusOr<std::string> new_upload_path() override {
    std::filesystem::create_directories(folder_);
    return folder_ + "/upload";
  }
  absl::Status publish(const std::string& upload_path, const contract::Digest& digest) override {
    std::string bytes(std::filesystem::file_size(upload_path), '\0');
    std::ifstream(upload_path, std::ios::binary)
        .read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    std::filesystem::remove(upload_path);
    return add(digest, bytes);
  }
  absl::Status drop(const contract::Digest& digest, std::int64_t stored_us) override {
    const std::lock_guard lock(mutex_);
    if (stored_us == store_count_) contents_.erase(digest);
    return absl::OkStatus();
  }
  absl::Status release(const std::vector<contract::Digest>&) override { return absl::OkStatus(); }
  absl::Status collect(std::int64_t, std::int64_t, const std::vector<contract::Digest>&) override {
    ++collection_count_;
    return absl::OkStatus();
  }
  std::int64_t used_bytes() const override { return used_bytes_; }

 private:
  const std::string folder_;
  mutable std::mutex mutex_;
  std::map<contract::Digest, std::string> contents_;
  std::int64_t store_count_ = 0;  // number of times that any asset was stored, instead of a time
  std::int64_t used_bytes_ = 0;
  int collection_count_ = 0;
};

}  // namespace tessera::server
