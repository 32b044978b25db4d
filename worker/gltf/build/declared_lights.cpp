#include "worker/gltf/build/declared_lights.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "worker/gltf/model/hierarchy.h"

namespace tessera::render {

namespace {

bool has_animated_emission(const GltfModel& document, std::int32_t material) {
  const std::string element = absl::StrCat("/materials/", material, "/");
  return std::any_of(document.animations.begin(), document.animations.end(), [&](const auto& a) {
    return std::any_of(a.pointers.begin(), a.pointers.end(), [&](const PointerChannel& channel) {
      return channel.pointer.starts_with(element) &&
             absl::StrContains(channel.pointer, "/emissive");
    });
  });
}

bool may_shine(const GltfModel& document, std::int32_t index) {
  // The material of primitives that name none comes after all others, and is dark.
  if (index == kNone || static_cast<std::size_t>(index) >= document.materials.size()) return false;
  const Material& material = document.materials[index];
  return !material.unlit &&
         (max_component(material.emission) > 0 || has_animated_emission(document, index));
}

}  // namespace

bool declares_light(const GltfModel& document, const std::vector<std::int32_t>& roots,
                    const std::function<std::int32_t(const GltfPrimitive&)>& material_of) {
  const auto order = depth_first(document.nodes, roots, HiddenNodes::included);
  return std::any_of(order.begin(), order.end(), [&](std::int32_t index) {
    const Node& node = document.nodes[index];
    if (node.light != kNone) return true;
    if (node.shape != nullptr && may_shine(document, node.shape_material)) return true;
    if (node.mesh == kNone) return false;
    const auto& primitives = document.meshes[node.mesh].primitives;
    return std::any_of(primitives.begin(), primitives.end(), [&](const GltfPrimitive& p) {
      return may_shine(document, material_of(p));
    });
  });
}

}  // namespace tessera::render
