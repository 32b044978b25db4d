#include "worker/gltf/build/declared_lights.h"

#include <algorithm>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "worker/gltf/model/hierarchy.h"

namespace tessera::render {

namespace {

/// Returns whether an animation changes the emission of an element such as "/materials/0/".
bool has_animated_emission(const GltfModel& model, const std::string& element) {
  return std::any_of(model.animations.begin(), model.animations.end(), [&](const auto& a) {
    return std::any_of(a.pointers.begin(), a.pointers.end(), [&](const PointerChannel& channel) {
      return channel.pointer.starts_with(element) &&
             (absl::StrContains(channel.pointer, "/emissive") ||
              channel.pointer.ends_with("/TESSERA_medium/emission"));
    });
  });
}

bool may_emit(const GltfModel& model, std::int32_t index) {
  // The default material, which follows all others, does not emit.
  if (index == kNone || static_cast<std::size_t>(index) >= model.materials.size()) return false;
  const Material& material = model.materials[index];
  return gives_light(material) ||
         (!material.unlit && has_animated_emission(model, absl::StrCat("/materials/", index, "/")));
}

}  // namespace

bool declares_light(const GltfModel& model, std::int32_t scene,
                    const std::vector<std::int32_t>& roots,
                    const std::function<std::int32_t(const GltfPrimitive&)>& material_of) {
  if (scene != kNone && has_animated_emission(model, absl::StrCat("/scenes/", scene, "/"))) {
    return true;
  }
  const auto order = depth_first(model.nodes, roots, HiddenNodes::included);
  return std::any_of(order.begin(), order.end(), [&](std::int32_t index) {
    const Node& node = model.nodes[index];
    if (node.light != kNone) return true;
    if (node.shape != nullptr && may_emit(model, node.shape_material)) return true;
    if (node.mesh == kNone) return false;
    const auto& primitives = model.meshes[node.mesh].primitives;
    return std::any_of(primitives.begin(), primitives.end(),
                       [&](const GltfPrimitive& p) { return may_emit(model, material_of(p)); });
  });
}

}  // namespace tessera::render
