#include "worker/gltf/decode/compression.h"

#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/draco_decoder.h"
#include "worker/gltf/decode/meshopt_decoder.h"
#include "worker/gltf/file/json_view.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {

using nlohmann::json;

namespace {

constexpr std::string_view kMeshopt = "EXT_meshopt_compression";
constexpr std::string_view kDraco = "KHR_draco_mesh_compression";
constexpr std::int64_t kSizeLimit = std::int64_t{1} << 40;

absl::Status at(const std::string& path, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
}

/// Bytes of a range, an object with buffer, byteOffset and byteLength.
absl::StatusOr<std::span<const std::byte>> bytes_of_range(const JsonView& range,
                                                          const GltfModel& model,
                                                          const JsonFault& fault) {
  const std::int32_t buffer = range.index("buffer", model.buffers.size());
  const std::int64_t offset = range.integer("byteOffset", kSizeLimit);
  const std::int64_t length = range.integer("byteLength", kSizeLimit);
  absl::Status valid = fault.status();
  if (!valid.ok()) return valid;
  if (buffer == kNone || length < 0) {
    return absl::InvalidArgumentError(absl::StrCat(range.path(), ": no buffer or byteLength"));
  }
  const auto bytes = model.buffers[buffer];
  const auto begin = static_cast<std::size_t>(offset < 0 ? 0 : offset);
  const auto size = static_cast<std::size_t>(length);
  if (begin > bytes.size() || size > bytes.size() - begin) {
    return absl::InvalidArgumentError(absl::StrCat(range.path(), ": ", size, " bytes at offset ",
                                                   begin, " exceed the ", bytes.size(),
                                                   " bytes of buffers[", buffer, "]"));
  }
  return bytes.subspan(begin, size);
}

/// Adds `bytes` to the model as a new buffer and returns its index.
std::size_t keep(std::vector<std::byte> bytes, GltfModel& model) {
  model.owned.push_back(std::move(bytes));
  model.buffers.emplace_back(model.owned.back());
  return model.buffers.size() - 1;
}

std::size_t add_view(json& root, std::vector<std::byte> bytes, GltfModel& model) {
  const std::size_t length = bytes.size();
  const std::size_t buffer = keep(std::move(bytes), model);
  json& views = root["bufferViews"];
  views.push_back({{"buffer", buffer}, {"byteLength", length}});
  return views.size() - 1;
}

absl::Status expand_view(json& view, const JsonView& json_view, const JsonFault& fault,
                         GltfModel& model) {
  const JsonView extension = json_view.extension(kMeshopt);
  const auto encoded = bytes_of_range(extension, model, fault);
  if (!encoded.ok()) return encoded.status();
  const std::int64_t count = extension.integer("count", kSizeLimit);
  const std::int64_t stride = extension.integer("byteStride", kSizeLimit);
  const std::string mode = extension.text("mode"), filter = extension.text("filter");
  absl::Status valid = fault.status();
  if (!valid.ok()) return valid;
  auto decoded =
      decode_meshopt(*encoded, {static_cast<std::size_t>(count < 0 ? 0 : count),
                                static_cast<std::size_t>(stride < 0 ? 0 : stride), mode, filter});
  if (!decoded.ok()) return at(extension.path(), decoded.status());
  const std::size_t length = decoded->size();
  view["buffer"] = keep(*std::move(decoded), model);
  view["byteOffset"] = 0;
  view["byteLength"] = length;
  if (mode == "ATTRIBUTES") view["byteStride"] = stride;
  return absl::OkStatus();
}

ComponentType component_type_of(std::int64_t code) {
  switch (code) {
    case 5120:
      return ComponentType::i8;
    case 5121:
      return ComponentType::u8;
    case 5122:
      return ComponentType::i16;
    case 5123:
      return ComponentType::u16;
    case 5125:
      return ComponentType::u32;
    default:
      return ComponentType::f32;
  }
}

int components_of(const std::string& type) {
  if (type == "SCALAR") return 1;
  return type == "VEC2" ? 2 : type == "VEC3" ? 3 : type == "VEC4" ? 4 : 0;
}

/// Decoding of one Draco primitive into new views of its accessors.
struct DracoPrimitive {
  json& root;
  JsonView json_view;
  const DracoGeometry& geometry;
  JsonFault& fault;
  GltfModel& model;

  absl::Status replace(std::int32_t accessor, std::size_t count, std::vector<std::byte> bytes) {
    json& a = root["accessors"][accessor];
    if (!a.is_object() || !a.contains("count") || a["count"] != count) {
      return absl::InvalidArgumentError(absl::StrCat(json_view.path(), ": accessors[", accessor,
                                                     "] does not have the Draco stream's count ",
                                                     count));
    }
    a["bufferView"] = add_view(root, std::move(bytes), model);
    a["byteOffset"] = 0;
    a.erase("sparse");
    return absl::OkStatus();
  }

  absl::Status replace_indices() {
    const std::size_t accessors = root["accessors"].size();
    const std::int32_t accessor = json_view.index("indices", accessors);
    absl::Status valid = fault.status();
    if (!valid.ok()) return valid;
    if (accessor == kNone) {
      return absl::InvalidArgumentError(absl::StrCat(json_view.path(), ": Draco without indices"));
    }
    auto indices = geometry.indices();
    if (!indices.ok()) return at(json_view.path(), indices.status());
    absl::Status done = replace(accessor, geometry.triangles() * 3, *std::move(indices));
    if (done.ok()) root["accessors"][accessor]["componentType"] = 5125;
    return done;
  }

  absl::Status replace_attribute(const std::string& name) {
    const std::int64_t id =
        json_view.extension(kDraco)["attributes"].integer(name, std::int64_t{1} << 31);
    const std::int32_t accessor = json_view["attributes"].index(name, root["accessors"].size());
    absl::Status valid = fault.status();
    if (!valid.ok()) return valid;
    if (accessor == kNone)
      return absl::OkStatus();  // the stream has more attributes than the primitive
    const JsonView a(root["accessors"][accessor], absl::StrCat("accessors[", accessor, "]"), fault);
    const int components = components_of(a.text("type"));
    const ComponentType type = component_type_of(a.integer("componentType", 1 << 16));
    absl::Status read = fault.status();
    if (!read.ok()) return read;
    auto bytes = geometry.attribute(id, type, components);
    if (!bytes.ok()) return at(json_view.path() + "." + name, bytes.status());
    // Elements must be aligned to 4, but unpadded ones are accepted and read at their true size.
    return replace(accessor, geometry.points(), *std::move(bytes));
  }
};

absl::Status expand_primitive(json& root, const JsonView& primitive, JsonFault& fault,
                              GltfModel& model) {
  const JsonView extension = primitive.extension(kDraco);
  const std::size_t view_count = root.contains("bufferViews") ? root["bufferViews"].size() : 0;
  const std::int32_t view = extension.index("bufferView", view_count);
  absl::Status valid = fault.status();
  if (!valid.ok()) return valid;
  if (view == kNone || !root.contains("accessors") || !root["accessors"].is_array()) {
    return absl::InvalidArgumentError(absl::StrCat(extension.path(), ": no bufferView"));
  }
  const JsonView range(root["bufferViews"][view], absl::StrCat("bufferViews[", view, "]"), fault);
  const auto stream = bytes_of_range(range, model, fault);
  if (!stream.ok()) return stream.status();
  const auto geometry = DracoGeometry::decode(*stream);
  if (!geometry.ok()) return at(extension.path(), geometry.status());
  DracoPrimitive work{root, primitive, **geometry, fault, model};
  valid = work.replace_indices();
  for (const std::string& name : extension["attributes"].keys()) {
    if (valid.ok()) valid = work.replace_attribute(name);
  }
  return valid.ok() ? fault.status() : valid;
}

}  // namespace

absl::Status expand_meshopt(json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  const std::vector<JsonView> views = JsonView(root, "", fault)["bufferViews"].items();
  for (std::size_t i = 0; i < views.size(); ++i) {
    JsonFault own;
    json& view = root["bufferViews"][i];
    const JsonView json_view(view, views[i].path(), own);
    if (!json_view.extension(kMeshopt).present()) continue;
    const absl::Status status = expand_view(view, json_view, own, model);
    if (!status.ok()) model.faults.add(json_view.path(), status);
  }
  return fault.status();
}

absl::Status expand_draco(json& root, GltfModel& model) {
  // Iterates over a copy, because views are added to `root` meanwhile.
  const auto meshes = root.find("meshes");
  if (meshes == root.end()) return absl::OkStatus();
  const json copy = *meshes;
  JsonFault fault(model.faults);
  const std::vector<JsonView> all = JsonView(copy, "meshes", fault).items();
  for (std::size_t i = 0; i < all.size(); ++i) {
    JsonFault own;
    for (const JsonView& primitive : JsonView(copy[i], all[i].path(), own)["primitives"].items()) {
      const bool compressed = primitive.extension(kDraco).present();
      absl::Status status = own.status();
      if (status.ok() && compressed) status = expand_primitive(root, primitive, own, model);
      if (!status.ok()) model.faults.add(all[i].path(), status);
    }
    if (!own.status().ok()) model.faults.add(all[i].path(), own.status());
  }
  return fault.status();
}

}  // namespace tessera::render
