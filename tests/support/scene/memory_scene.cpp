#include "tests/support/scene/memory_scene.h"

namespace tessera::testing {

absl::StatusOr<std::span<const std::byte>> MemoryReader::read(std::string_view uri) {
  const auto it = files_.find(uri);
  if (it == files_.end()) return absl::NotFoundError("no such file: " + std::string(uri));
  return std::as_bytes(std::span<const char>(it->second));
}

absl::StatusOr<render::Scene> load_and_pose(const std::string& file,
                                            const contract::RenderSettings& settings,
                                            std::int32_t frame) {
  MemoryReader reader;
  reader.put("scene.gltf", file);
  auto loaded = render::load_scene_file("scene.gltf", settings, reader);
  if (!loaded.ok()) return loaded.status();
  return (*loaded)->pose(settings, frame);
}

absl::StatusOr<render::Scene> load_and_pose(const GltfBuilder& builder,
                                            const contract::RenderSettings& settings,
                                            std::int32_t frame) {
  return load_and_pose(builder.gltf(), settings, frame);
}

}  // namespace tessera::testing
