#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "worker/gltf/build/loader.h"

namespace tessera::testing {

/// Reads files below a folder, for tools that render without a server. Absolute paths are read as
/// they are, so that an environment map may be elsewhere.
class FolderReader final : public render::ResourceReader {
 public:
  explicit FolderReader(std::filesystem::path folder) : folder_(std::move(folder)) {}
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override;

 private:
  std::filesystem::path folder_;
  std::map<std::string, std::string, std::less<>> files_;
};

}  // namespace tessera::testing
