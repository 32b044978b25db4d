#include <algorithm>
#include <set>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/links/linked_document.h"
#include "worker/gltf/validate/schema/attribute_names.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;
using Formats = std::vector<AccessorFormat>;

void add_formats(Formats& out, std::string_view type,
                 std::initializer_list<std::int64_t> components, bool normalized) {
  for (const std::int64_t component : components) out.push_back({type, component, normalized});
}

/// Formats that glTF allows for an attribute; empty if any is. Source: glTF 2.0, section 3.7.2.1;
/// KHR_mesh_quantization.
Formats attribute_formats(std::string_view semantic, bool quantized, bool of_target) {
  Formats out;
  if (semantic == "POSITION" || semantic == "NORMAL") add_formats(out, "VEC3", {kFloat}, false);
  if (semantic == "TANGENT") add_formats(out, of_target ? "VEC3" : "VEC4", {kFloat}, false);
  if (semantic == "TEXCOORD") {
    add_formats(out, "VEC2", {kFloat}, false);
    add_formats(out, "VEC2", {kUnsignedByte, kUnsignedShort}, true);
    if (of_target) add_formats(out, "VEC2", {kByte, kShort}, true);
  }
  if (semantic == "COLOR") {
    for (const char* type : {"VEC3", "VEC4"}) {
      add_formats(out, type, {kFloat}, false);
      add_formats(out, type, {kUnsignedByte, kUnsignedShort}, true);
      if (of_target) add_formats(out, type, {kByte, kShort}, true);
    }
  }
  if (semantic == "JOINTS" && !of_target) {
    add_formats(out, "VEC4", {kUnsignedByte, kUnsignedShort}, false);
  }
  if (semantic == "WEIGHTS" && !of_target) {
    add_formats(out, "VEC4", {kFloat}, false);
    add_formats(out, "VEC4", {kUnsignedByte, kUnsignedShort}, true);
  }
  if (!quantized) return out;
  if (semantic == "POSITION") {
    add_formats(out, "VEC3", {kByte, kShort}, true);
    add_formats(out, "VEC3", {kByte, kShort}, false);
    if (!of_target) {
      add_formats(out, "VEC3", {kUnsignedByte, kUnsignedShort}, true);
      add_formats(out, "VEC3", {kUnsignedByte, kUnsignedShort}, false);
    }
  }
  if (semantic == "NORMAL") add_formats(out, "VEC3", {kByte, kShort}, true);
  if (semantic == "TANGENT") {
    add_formats(out, of_target ? "VEC3" : "VEC4", {kByte, kShort}, true);
  }
  if (semantic == "TEXCOORD") {
    add_formats(out, "VEC2", {kByte, kShort}, false);
    if (!of_target) {
      add_formats(out, "VEC2", {kByte, kShort}, true);
      add_formats(out, "VEC2", {kUnsignedByte, kUnsignedShort}, false);
    }
  }
  return out;
}

/// Links of one primitive.
class PrimitiveLinks {
 public:
  PrimitiveLinks(LinkedDocument& document, const JsonNode& json, std::string path,
                 LinkedPrimitive& primitive)
      : document_(document), json_(json), path_(std::move(path)), primitive_(primitive) {}

  void link() {
    const JsonNode& attributes = json_["attributes"];
    const int sets = std::max(numbered_sets(attributes, "TEXCOORD"), 0);
    unused_texcoords_.assign(static_cast<std::size_t>(sets), true);
    const int joints = std::max(numbered_sets(attributes, "JOINTS"), 0);
    if (joints == std::max(numbered_sets(attributes, "WEIGHTS"), 0)) primitive_.joint_sets = joints;
    link_variants();
    const std::string path = pointer_to(path_, "attributes");
    for (std::size_t i = 0; i < attributes.size(); ++i) {
      link_attribute(attributes.keys()[i], attributes.items()[i], path);
    }
    std::int64_t count = primitive_.vertices;
    link_indices(count);
    check_mode(count);
    link_material(attributes);
    for (std::size_t i = 0; i < unused_texcoords_.size(); ++i) {
      if (!unused_texcoords_[i]) continue;
      document_.findings.add_at(rules::kUnusedObject, path, "TEXCOORD_" + std::to_string(i));
    }
    link_targets();
  }

 private:
  /// Checks that base attributes and those of targets have in common.
  const LinkedAccessor* link_vertices(const std::string& name, std::int64_t index,
                                      const std::string& path) {
    if (document_.resolve(document_.accessors, index, path, name) == nullptr) return nullptr;
    const std::string pointer = pointer_to(path, name);
    document_.use_accessor(index, AccessorRole::attribute, pointer);
    const LinkedAccessor& accessor = document_.linked_accessors[static_cast<std::size_t>(index)];
    if (accessor.view != kNoIndex) {
      document_.use_view(accessor.view, ViewRole::vertices, pointer);
    }
    if (name == "POSITION" && !accessor.has_bounds) {
      document_.findings.add(rules::kMeshPrimitivePositionAccessorWithoutBounds, pointer);
    }
    const LinkedView* view = document_.view_of(accessor);
    const bool packed = view != nullptr && view->stride == -1;
    if ((accessor.offset != -1 && accessor.offset % 4 != 0) ||
        (packed && accessor.element_bytes() % 4 != 0)) {
      document_.findings.add(rules::kMeshPrimitiveAccessorUnaligned, pointer);
    }
    if (packed) check_shared_view(accessor.view, index, pointer);
    return &accessor;
  }

  /// Several attributes cannot be packed in one view without a stride.
  void check_shared_view(std::int64_t view, std::int64_t accessor, const std::string& pointer) {
    std::int64_t& other = document_.views[static_cast<std::size_t>(view)].attribute;
    if (other == kNoIndex) {
      other = accessor;
    } else if (other != accessor && document_.sharing_accessors.insert(accessor).second) {
      document_.findings.add(rules::kMeshPrimitiveAccessorWithoutBytestride, pointer);
    }
  }

  [[nodiscard]] bool has_format(const LinkedAccessor& accessor, std::string_view name,
                                bool of_target, bool& is_known) const {
    const bool quantized = document_.checked.enabled.count("KHR_mesh_quantization") != 0;
    const Formats formats = attribute_formats(semantic_of(name), quantized, of_target);
    is_known = !formats.empty();
    return std::find(formats.begin(), formats.end(), accessor.format) != formats.end();
  }

  void link_attribute(const std::string& name, const JsonNode& value, const std::string& path) {
    const std::int64_t index = value.as_integer();
    const LinkedAccessor* accessor = link_vertices(name, index, path);
    if (accessor == nullptr) return;
    primitive_.attributes.emplace(name, index);
    const std::string pointer = pointer_to(path, name);
    bool is_known = false;
    if (has_format(*accessor, name, false, is_known)) {
      add_value_check(name, index, *accessor, pointer);
    } else if (is_known) {
      document_.findings.add(rules::kMeshPrimitiveAttributesAccessorInvalidFormat, pointer);
    } else if (accessor->format.component == kUnsignedInt) {
      document_.findings.add(rules::kMeshPrimitiveAttributesAccessorUnsignedInt, pointer);
    }
    if (primitive_.vertices == kNoIndex) {
      primitive_.vertices = accessor->count;
    } else if (primitive_.vertices != accessor->count) {
      document_.findings.add(rules::kMeshPrimitiveUnequalAccessorCount, pointer);
    }
  }

  void add_value_check(const std::string& name, std::int64_t index, const LinkedAccessor& accessor,
                       const std::string& pointer) {
    if (name == "NORMAL") add_check(ValueCheck::Kind::unit_vectors, index, pointer);
    if (name == "TANGENT") add_check(ValueCheck::Kind::tangents, index, pointer);
    if (name == "COLOR_0" && accessor.format.component == kFloat) {
      add_check(ValueCheck::Kind::colours, index, pointer);
    }
  }

  void add_check(ValueCheck::Kind kind, std::int64_t index, const std::string& pointer) {
    document_.value_checks.push_back({kind, index, pointer});
  }

  void link_indices(std::int64_t& count) {
    const std::int64_t index = json_.integer("indices");
    if (document_.resolve(document_.accessors, index, path_, "indices") == nullptr) return;
    const std::string pointer = pointer_to(path_, "indices");
    const LinkedAccessor& accessor = document_.linked_accessors[static_cast<std::size_t>(index)];
    count = accessor.count;
    document_.use_accessor(index, AccessorRole::indices, pointer);
    if (accessor.view != kNoIndex) document_.use_view(accessor.view, ViewRole::indices, pointer);
    const LinkedView* view = document_.view_of(accessor);
    if (view != nullptr && view->stride != -1) {
      document_.findings.add(rules::kMeshPrimitiveIndicesAccessorWithBytestride, pointer);
    }
    const AccessorFormat& format = accessor.format;
    const bool valid = format.type == "SCALAR" && !format.normalized &&
                       (format.component == kUnsignedByte || format.component == kUnsignedShort ||
                        format.component == kUnsignedInt);
    if (!valid) {
      document_.findings.add(rules::kMeshPrimitiveIndicesAccessorInvalidFormat, pointer);
      return;
    }
    ValueCheck check{ValueCheck::Kind::indices, index, pointer};
    check.vertices = primitive_.vertices;
    const std::int64_t mode = json_.integer("mode", 4);
    check.triangles = mode == 4 || mode == -1;
    document_.value_checks.push_back(check);
  }

  void check_mode(std::int64_t count) {
    const std::int64_t mode = json_.integer("mode", 4);
    const bool fits = count == kNoIndex ||
                      ((mode != 1 || count % 2 == 0) && ((mode != 2 && mode != 3) || count >= 2) &&
                       (mode != 4 || count % 3 == 0) && ((mode != 5 && mode != 6) || count >= 3));
    if (!fits) document_.findings.add(rules::kMeshPrimitiveIncompatibleMode, path_);
  }

  void link_material(const JsonNode& attributes) {
    const std::int64_t index = json_.integer("material");
    const LinkedMaterial* material = nullptr;
    if (document_.resolve(document_.materials, index, path_, "material") != nullptr) {
      material = &document_.linked_materials[static_cast<std::size_t>(index)];
      const bool has_tangents = attributes.has("NORMAL") && attributes.has("TANGENT");
      if (!has_tangents && material->needs_tangents) {
        document_.findings.add_at(material->has_normal_texture
                                      ? rules::kMeshPrimitiveGeneratedTangentSpace
                                      : rules::kMeshPrimitiveNoTangentSpace,
                                  path_, "material");
      }
      use_texcoords(*material, path_);
    }
    if (attributes.has("TANGENT") && (material == nullptr || !material->needs_tangents)) {
      document_.findings.add_at(rules::kUnusedMeshTangent, pointer_to(path_, "attributes"),
                                "TANGENT");
    }
  }

  void use_texcoords(const LinkedMaterial& material, const std::string& path) {
    for (const auto& [pointer, set] : material.texcoords) {
      if (set == kNoIndex) continue;
      if (set >= static_cast<std::int64_t>(unused_texcoords_.size())) {
        document_.findings.add_at(rules::kMeshPrimitiveTooFewTexcoords, path, "material",
                                  pointer + " uses TEXCOORD_" + std::to_string(set));
      } else {
        unused_texcoords_[static_cast<std::size_t>(set)] = false;
      }
    }
  }

  void link_variants() {
    const JsonNode& extension = document_.checked.extension(json_, "KHR_materials_variants");
    const JsonNode& mappings = extension["mappings"];
    const std::string path = path_ + "/extensions/KHR_materials_variants/mappings";
    std::set<std::int64_t> mapped;
    for (std::size_t i = 0; i < mappings.size(); ++i) {
      link_variant_mapping(mappings.items()[i], pointer_to(path, i), mapped);
    }
  }

  void link_variant_mapping(const JsonNode& mapping, const std::string& path,
                            std::set<std::int64_t>& mapped) {
    if (!document_.checked.extension(document_.checked.root, "KHR_materials_variants")
             .is(Kind::object)) {
      document_.findings.add(rules::kUnsatisfiedDependency, path,
                             "/extensions/KHR_materials_variants");
      return;
    }
    const JsonNode& variants = mapping["variants"];
    const std::string inner = pointer_to(path, "variants");
    for (std::size_t i = 0; i < variants.size(); ++i) {
      const std::int64_t variant = variants.items()[i].as_integer();
      if (variant == kNoIndex) continue;
      if (!mapped.insert(variant).second) {
        document_.findings.add_at(rules::kKhrMaterialsVariantsNonUniqueVariant, inner, i);
      }
      document_.resolve(document_.variants, variant, inner, std::to_string(i));
    }
    const std::int64_t material = mapping.integer("material");
    if (document_.resolve(document_.materials, material, path, "material") != nullptr) {
      use_texcoords(document_.linked_materials[static_cast<std::size_t>(material)], path);
    }
  }

  void link_targets() {
    const JsonNode& targets = json_["targets"];
    if (!targets.is(Kind::array)) return;
    primitive_.targets = targets.size();
    const std::string path = pointer_to(path_, "targets");
    for (std::size_t i = 0; i < targets.size(); ++i) {
      const JsonNode& target = targets.items()[i];
      for (std::size_t k = 0; k < target.size(); ++k) {
        link_displacement(target.keys()[k], target.items()[k], pointer_to(path, i));
      }
    }
  }

  void link_displacement(const std::string& name, const JsonNode& value, const std::string& path) {
    const LinkedAccessor* accessor = link_vertices(name, value.as_integer(), path);
    if (accessor == nullptr) return;
    const std::string pointer = pointer_to(path, name);
    const auto base = primitive_.attributes.find(name);
    if (base == primitive_.attributes.end()) {
      document_.findings.add(rules::kMeshPrimitiveMorphTargetNoBaseAccessor, pointer);
    } else if (document_.linked_accessors[static_cast<std::size_t>(base->second)].count !=
               accessor->count) {
      document_.findings.add(rules::kMeshPrimitiveMorphTargetInvalidAttributeCount, pointer);
    }
    bool is_known = false;
    if (!has_format(*accessor, name, true, is_known) && is_known) {
      document_.findings.add(rules::kMeshPrimitiveAttributesAccessorInvalidFormat, pointer);
    }
  }

  LinkedDocument& document_;
  const JsonNode& json_;
  std::string path_;
  LinkedPrimitive& primitive_;
  std::vector<bool> unused_texcoords_;
};

}  // namespace

void link_meshes(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.meshes.size(); ++i) {
    const JsonNode* json = document.meshes.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    const JsonNode& primitives = (*json)["primitives"];
    const std::string path = pointer_to(document.meshes.pointer(i), "primitives");
    std::vector<LinkedPrimitive>& linked = document.linked_meshes[i].primitives;
    linked.resize(primitives.size());
    for (std::size_t k = 0; k < primitives.size(); ++k) {
      PrimitiveLinks(document, primitives.items()[k], pointer_to(path, k), linked[k]).link();
    }
  }
}

}  // namespace tessera::render
