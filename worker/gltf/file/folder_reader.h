#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "worker/gltf/file/resource_reader.h"

namespace tessera::render {

/// Reads files beneath one folder and nowhere else: no absolute path, no `..`, no symbolic link
/// that leads out of it, regular files only. Files named with allow() may lie anywhere.
class FolderReader final : public ResourceReader {
 public:
  /// `folder` must exist to read anything.
  explicit FolderReader(const std::filesystem::path& folder);
  ~FolderReader() override;

  /// Lets `uri` name the file `path`, wherever it is (the sky of the command line).
  void allow(std::string uri, std::filesystem::path path);

  /// Errors: NotFound, PermissionDenied (outside the folder, not a regular file, not readable).
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override;

  /// Where `uri`, read before, lies on disk; empty if it was not read.
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
};

}  // namespace tessera::render
