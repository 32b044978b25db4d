#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "worker/gltf/file/resource_reader.h"

namespace tessera::render {

/// Reads regular files below one directory. Rejects absolute paths, `..` and symbolic links that
/// lead out of it. Files named with allow() may be anywhere.
class FolderReader final : public ResourceReader {
 public:
  /// `folder` must exist for read() to succeed.
  explicit FolderReader(const std::filesystem::path& folder);
  ~FolderReader() override;

  /// Lets `uri` name the file `path` anywhere (for the environment map of the command line).
  void allow(std::string uri, std::filesystem::path path);

  /// Errors: NotFound; PermissionDenied if the file is outside the directory, not regular or not
  /// readable.
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override;
  /// That of machine_memory_bytes().
  std::uint64_t memory_bytes() const override { return memory_bytes_; }

  /// Path of `uri` on disk; empty if it has not been read.
  [[nodiscard]] std::filesystem::path path_of(std::string_view uri) const;
  /// URIs read so far, in order.
  [[nodiscard]] const std::vector<std::string>& uris() const { return uris_; }

 private:
  struct Mapping {
    std::filesystem::path path;
    const std::byte* data = nullptr;
    std::size_t size = 0;
  };
  absl::StatusOr<std::filesystem::path> resolve(std::string_view uri) const;

  std::filesystem::path folder_;
  std::map<std::string, std::filesystem::path, std::less<>> allowed_;
  std::map<std::string, Mapping, std::less<>> files_;
  std::vector<std::string> uris_;
  std::uint64_t memory_bytes_;
};

}  // namespace tessera::render
