#include "worker/gltf/checks/part_use.h"

#include <string_view>

#include "absl/strings/str_cat.h"
#include "worker/scene/texture_refs.h"

namespace tessera::render {

namespace {

/// Visits parts, dependencies first, and keeps the first fault.
class PartUse {
 public:
  explicit PartUse(const GltfModel& model) : model_(model) {}

  [[nodiscard]] const absl::Status& status() const { return status_; }

  void node(const Node& node) {
    if (node.mesh != kNone) mesh(node.mesh);
    if (node.skin != kNone) {
      accessor(model_.skins[node.skin].inverse_bind_matrices);
      part("skins", node.skin);
    }
    part("lights", node.light);
    attributes(node.instancing);
  }

  void animation(std::int32_t index) { part("animations", index); }

  void material(std::int32_t index) {
    const Material& material = model_.materials[index];
    for (const TextureRef* ref : texture_refs(material)) {
      if (*ref) texture(ref->texture);
    }
    if (material.medium) texture(material.medium->procedural);
    part("materials", index);
  }

 private:
  void part(std::string_view section, std::int32_t index) {
    if (!status_.ok()) return;
    const absl::Status* fault = model_.faults.find(section, index);
    if (fault != nullptr) status_ = *fault;
  }

  /// Faults of views and buffers are also faults of the accessors in them.
  void accessor(std::int32_t index) { part("accessors", index); }

  void attributes(const Attributes& attributes) {
    for (const auto& [name, index] : attributes) accessor(index);
  }

  void mesh(std::int32_t index) {
    for (const GltfPrimitive& primitive : model_.meshes[index].primitives) {
      accessor(primitive.indices);
      attributes(primitive.attributes);
      for (const Attributes& target : primitive.targets) attributes(target);
    }
    part("meshes", index);
  }

  void texture(std::int32_t index) {
    if (index == kNone) return;
    const GltfTexture& texture = model_.texture_sources[index];
    part("samplers", texture.sampler);
    if (texture.procedural == kNone) part("images", texture.image);
    part("textures", index);
  }

  const GltfModel& model_;
  absl::Status status_;
};

}  // namespace

absl::Status check_used_parts(const GltfModel& model, const std::vector<std::int32_t>& order,
                              const std::vector<std::int32_t>& animations) {
  if (model.faults.empty()) return absl::OkStatus();
  PartUse use(model);
  for (const std::int32_t node : order) use.node(model.nodes[node]);
  for (const std::int32_t animation : animations) use.animation(animation);
  return use.status();
}

absl::Status check_used_material(const GltfModel& model, std::int32_t material) {
  if (model.faults.empty()) return absl::OkStatus();
  PartUse use(model);
  use.material(material);
  return use.status();
}

std::vector<Problem> unused_part_warnings(const GltfModel& model) {
  std::vector<Problem> out;
  for (const auto& [part, fault] : model.faults.all()) {
    // Messages of faults are "ELEMENT: FAULT".
    const std::string message(fault.message());
    const std::size_t colon = message.find(": ");
    const bool split = colon != std::string::npos;
    out.push_back({Problem::Severity::warning, split ? message.substr(0, colon) : part,
                   absl::StrCat(split ? message.substr(colon + 2) : message,
                                "; ignored, because the scene does not use it")});
  }
  return out;
}

}  // namespace tessera::render
