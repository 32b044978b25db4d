#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "tests/support/scene/memory_scene.h"

// Loads and poses scene files, which come from strangers. Any file may be refused as bad input; an
// accepted one must meet the guarantees of scene.h: indices in range, positions finite, a material
// for every primitive.

namespace {

using tessera::render::Primitive;
using tessera::render::Scene;

void check_primitive(const Primitive& p, const Scene& scene) {
  const std::size_t vertices = p.positions.size();
  const auto fits = [vertices](std::size_t size) { return size == 0 || size == vertices; };
  if (!fits(p.normals.size()) || !fits(p.tangents.size()) || !fits(p.uv[0].size()) ||
      !fits(p.uv[1].size()) || !fits(p.colors.size())) {
    std::abort();
  }
  if (p.material < 0 || static_cast<std::size_t>(p.material) >= scene.materials.size())
    std::abort();
  for (const auto& triangle : p.triangles) {
    for (const std::uint32_t v : triangle) {
      if (v >= vertices || !is_finite(p.positions[v])) std::abort();
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  tessera::contract::RenderSettings settings;
  settings.animation = "all";
  const std::string file(reinterpret_cast<const char*>(data), size);
  const auto scene = tessera::testing::load_and_pose(file, settings, 12);
  if (!scene.ok()) {
    const absl::StatusCode code = scene.status().code();
    const bool refused = code == absl::StatusCode::kInvalidArgument ||
                         code == absl::StatusCode::kUnimplemented ||
                         code == absl::StatusCode::kNotFound;
    if (!refused) std::abort();
    return 0;
  }
  for (const auto& mesh : scene->meshes) {
    for (const Primitive& primitive : mesh.primitives) check_primitive(primitive, *scene);
  }
  for (const auto& instance : scene->instances) {
    if (static_cast<std::size_t>(instance.mesh) >= scene->meshes.size()) std::abort();
  }
  return 0;
}
