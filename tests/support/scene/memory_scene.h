#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "tests/support/scene/gltf_builder.h"
#include "worker/gltf/build/loader.h"

namespace tessera::testing {

/// Resources held in memory: uri -> bytes.
class MemoryReader final : public render::ResourceReader {
 public:
  void put(std::string uri, std::string bytes) { files_[std::move(uri)] = std::move(bytes); }
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override;
  void limit_memory(std::uint64_t bytes) { memory_bytes_ = bytes; }
  std::uint64_t memory_bytes() const override { return memory_bytes_; }

 private:
  std::uint64_t memory_bytes_ = UINT64_MAX;
  std::map<std::string, std::string, std::less<>> files_;
};

/// Loads `file` (glTF text or GLB bytes, called "scene.gltf") and poses `frame`.
absl::StatusOr<render::Scene> load_and_pose(const std::string& file,
                                            const contract::RenderSettings& settings = {},
                                            std::int32_t frame = 0);

/// The same for a builder's file, as JSON with a data URI.
absl::StatusOr<render::Scene> load_and_pose(const GltfBuilder& builder,
                                            const contract::RenderSettings& settings = {},
                                            std::int32_t frame = 0);

}  // namespace tessera::testing
