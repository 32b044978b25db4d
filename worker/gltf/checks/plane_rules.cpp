#include "worker/gltf/checks/plane_rules.h"

#include "absl/strings/str_cat.h"

namespace tessera::render {

PosedBox framing_box(const Shape& shape) {
  if (!shape.bounded()) return {{0, 0, 0}, {0, 0, 0}};
  return {Vec3d(shape.bounds.lo), Vec3d(shape.bounds.hi)};
}

std::vector<Problem> emissive_plane_warnings(const Scene& scene) {
  std::vector<Problem> out;
  for (const Instance& instance : scene.instances) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    if (mesh.shape == nullptr || mesh.shape->bounded()) continue;
    const auto material = static_cast<std::size_t>(mesh.primitives[0].material);
    if (!(max_component(scene.materials[material].emission) > 0)) continue;
    out.push_back(
        {Problem::Severity::warning, absl::StrCat("nodes[", instance.node, "]"),
         "a plane that emits light has no finite power, so it is not sampled as a light; a "
         "large rectangle or an environment map gives less noise"});
  }
  return out;
}

}  // namespace tessera::render
