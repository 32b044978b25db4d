#include "worker/gltf/validate/links/linked_document.h"

#include <algorithm>

#include "worker/gltf/validate/findings/rules.h"

namespace tessera::render {

namespace {

std::int64_t round_up_to_4(std::int64_t bytes) {
  return (bytes + 3) / 4 * 4;
}

std::int64_t columns_of(std::string_view type) {
  return type == "MAT2" ? 2 : type == "MAT3" ? 3 : type == "MAT4" ? 4 : 1;
}

LinkedView view_from(const JsonNode& json) {
  LinkedView view;
  view.offset = json.integer("byteOffset", 0);
  view.length = json.integer("byteLength");
  view.stride = json.integer("byteStride");
  const std::int64_t target = json.integer("target");
  view.role = target == 34962   ? ViewRole::vertices
              : target == 34963 ? ViewRole::indices
                                : ViewRole::none;
  return view;
}

LinkedAccessor accessor_from(const JsonNode& json) {
  LinkedAccessor out;
  out.offset = json.integer("byteOffset", 0);
  out.count = json.integer("count");
  out.format.type = json.text_of("type");
  out.format.component = json.integer("componentType");
  out.format.normalized = json["normalized"].is_true();
  const std::int64_t component = out.format.component;
  out.component_bytes = component == kNoIndex ? 0
                        : component <= 5121   ? 1
                        : component <= 5123   ? 2
                                              : 4;
  const std::string_view type = out.format.type;
  out.components = type == "SCALAR"                   ? 1
                   : type == "VEC2"                   ? 2
                   : type == "VEC3"                   ? 3
                   : type == "VEC4" || type == "MAT2" ? 4
                   : type == "MAT3"                   ? 9
                   : type == "MAT4"                   ? 16
                                                      : 0;
  const JsonNode& sparse = json["sparse"];
  out.has_sparse = sparse.is(JsonNode::Kind::object) && sparse.integer("count") != kNoIndex &&
                   sparse["indices"].is(JsonNode::Kind::object) &&
                   sparse["values"].is(JsonNode::Kind::object);
  out.has_bounds = json["min"].is(JsonNode::Kind::array) && json["max"].is(JsonNode::Kind::array);
  return out;
}

}  // namespace

Collection::Collection(std::string path, const JsonNode& array) : path_(std::move(path)) {
  for (const JsonNode& item : array.items()) {
    items_.push_back(item.is(JsonNode::Kind::object) ? &item : nullptr);
  }
  used_.resize(items_.size());
}

const JsonNode* Collection::get(std::int64_t index) const {
  return index >= 0 && index < static_cast<std::int64_t>(items_.size())
             ? items_[static_cast<std::size_t>(index)]
             : nullptr;
}

void Collection::report_unused(ValidationFindings& findings) const {
  for (std::size_t i = 0; i < items_.size(); ++i) {
    if (items_[i] != nullptr && !used_[i]) findings.add(rules::kUnusedObject, pointer(i));
  }
}

std::int64_t LinkedAccessor::packed_stride() const {
  const std::int64_t columns = columns_of(format.type);
  const std::int64_t column = components / columns * component_bytes;
  return columns == 1 ? column : columns * round_up_to_4(column);
}

std::int64_t LinkedAccessor::element_bytes() const {
  const std::int64_t columns = columns_of(format.type);
  const std::int64_t column = components / columns * component_bytes;
  return columns == 1 ? column : (columns - 1) * round_up_to_4(column) + column;
}

bool LinkedMesh::any_joints() const {
  return std::any_of(primitives.begin(), primitives.end(),
                     [](const LinkedPrimitive& each) { return each.joint_sets > 0; });
}

bool LinkedMesh::all_without_joints() const {
  return !any_joints();
}

LinkedDocument::LinkedDocument(const CheckedDocument& checked_document,
                               ValidationFindings& all_findings)
    : checked(checked_document), findings(all_findings) {
  const JsonNode& root = checked.root;
  const auto collection = [&root](const char* key) {
    return Collection(pointer_to("", key), root[key]);
  };
  accessors = collection("accessors");
  animations = collection("animations");
  buffers = collection("buffers");
  buffer_views = collection("bufferViews");
  cameras = collection("cameras");
  images = collection("images");
  materials = collection("materials");
  meshes = collection("meshes");
  nodes = collection("nodes");
  samplers = collection("samplers");
  scenes = collection("scenes");
  skins = collection("skins");
  textures = collection("textures");
  lights = Collection("/extensions/KHR_lights_punctual/lights",
                      checked.extension(root, "KHR_lights_punctual")["lights"]);
  variants = Collection("/extensions/KHR_materials_variants/variants",
                        checked.extension(root, "KHR_materials_variants")["variants"]);
  static const JsonNode nothing;
  for (std::size_t i = 0; i < buffer_views.size(); ++i) {
    const JsonNode* json = buffer_views.get(static_cast<std::int64_t>(i));
    views.push_back(view_from(json != nullptr ? *json : nothing));
  }
  for (std::size_t i = 0; i < accessors.size(); ++i) {
    const JsonNode* json = accessors.get(static_cast<std::int64_t>(i));
    linked_accessors.push_back(accessor_from(json != nullptr ? *json : nothing));
  }
  linked_materials.resize(materials.size());
  linked_meshes.resize(meshes.size());
  linked_nodes.resize(nodes.size());
  buffer_bytes.resize(buffers.size());
  image_types.resize(images.size());
}

const JsonNode* LinkedDocument::resolve(Collection& in, std::int64_t index, const std::string& path,
                                        std::string_view key) {
  if (index == kNoIndex) return nullptr;
  const JsonNode* found = in.get(index);
  if (found == nullptr) {
    findings.add_at(rules::kUnresolvedReference, path, key, std::to_string(index));
  } else {
    in.use(index);
  }
  return found;
}

void LinkedDocument::use_view(std::int64_t view_index, ViewRole role, const std::string& pointer) {
  buffer_views.use(view_index);
  LinkedView& view = views[static_cast<std::size_t>(view_index)];
  if (view.role == ViewRole::none) {
    view.role = role;
    if (role == ViewRole::vertices || role == ViewRole::indices) {
      findings.add(rules::kBufferViewTargetMissing, pointer);
    }
  } else if (view.role != role) {
    findings.add(rules::kBufferViewTargetOverride, pointer);
  }
}

void LinkedDocument::use_accessor(std::int64_t accessor_index, AccessorRole role,
                                  const std::string& pointer) {
  accessors.use(accessor_index);
  LinkedAccessor& accessor = linked_accessors[static_cast<std::size_t>(accessor_index)];
  if (accessor.role == AccessorRole::none) {
    accessor.role = role;
  } else if (accessor.role != role) {
    findings.add(rules::kAccessorUsageOverride, pointer);
  }
}

const LinkedView* LinkedDocument::view_of(const LinkedAccessor& accessor) const {
  return accessor.view == kNoIndex ? nullptr : &views[static_cast<std::size_t>(accessor.view)];
}

}  // namespace tessera::render
