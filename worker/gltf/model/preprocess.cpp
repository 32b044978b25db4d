#include "worker/gltf/model/preprocess.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "worker/gltf/file/json_view.h"
#include "worker/gltf/file/limits.h"
#include "worker/gltf/file/uri.h"
#include "worker/gltf/model/tessera_extensions.h"

namespace tessera::render {

using nlohmann::json;

namespace {

constexpr std::array<std::string_view, 24> kKnownExtensions = {
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_basisu",  // only the fallback image is used; see read_images()
    "KHR_texture_transform"};

bool is_known(std::string_view name) {
  return is_tessera_extension(name) || std::find(kKnownExtensions.begin(), kKnownExtensions.end(),
                                                 name) != kKnownExtensions.end();
}

/// Types that tinygltf expects under a key of the core specification, anywhere in the file.
enum Kind : unsigned {
  integer = 1,  // [0, 2^31)
  size = 2,     // an integer up to 2^40
  number = 4,
  numbers = 8,
  integers = 16,
  text = 32,
  flag = 64,
  object = 128,
  objects = 256,
};

struct KeyKind {
  std::string_view key;
  unsigned kinds;
};

constexpr KeyKind kSchema[] = {
    {"accessors", Kind::objects},
    {"alphaCutoff", Kind::number},
    {"alphaMode", Kind::text},
    {"animations", Kind::objects},
    {"aspectRatio", Kind::number},
    {"asset", Kind::object},
    {"attributes", Kind::object},
    {"baseColorFactor", Kind::numbers},
    {"baseColorTexture", Kind::object},
    {"buffer", Kind::integer},
    {"bufferView", Kind::integer},
    {"bufferViews", Kind::objects},
    {"buffers", Kind::objects},
    {"byteLength", Kind::size},
    {"byteOffset", Kind::size},
    {"byteStride", Kind::integer},
    {"camera", Kind::integer},
    {"cameras", Kind::objects},
    {"channels", Kind::objects},
    {"children", Kind::integers},
    {"componentType", Kind::integer},
    {"count", Kind::size},
    {"doubleSided", Kind::flag},
    {"emissiveFactor", Kind::numbers},
    {"emissiveTexture", Kind::object},
    {"images", Kind::objects},
    {"index", Kind::integer},
    {"indices", Kind::integer | Kind::object},
    {"input", Kind::integer},
    {"interpolation", Kind::text},
    {"inverseBindMatrices", Kind::integer},
    {"joints", Kind::integers},
    {"magFilter", Kind::integer},
    {"material", Kind::integer},
    {"materials", Kind::objects},
    {"matrix", Kind::numbers},
    {"max", Kind::numbers},
    {"mesh", Kind::integer},
    {"meshes", Kind::objects},
    {"metallicFactor", Kind::number},
    {"metallicRoughnessTexture", Kind::object},
    {"min", Kind::numbers},
    {"minFilter", Kind::integer},
    {"mode", Kind::integer},
    {"name", Kind::text},
    {"node", Kind::integer},
    {"nodes", Kind::objects | Kind::integers},
    {"normalTexture", Kind::object},
    {"normalized", Kind::flag},
    {"occlusionTexture", Kind::object},
    {"orthographic", Kind::object},
    {"output", Kind::integer},
    {"path", Kind::text},
    {"pbrMetallicRoughness", Kind::object},
    {"perspective", Kind::object},
    {"primitives", Kind::objects},
    {"rotation", Kind::numbers},
    {"roughnessFactor", Kind::number},
    {"sampler", Kind::integer},
    {"samplers", Kind::objects},
    {"scale", Kind::number | Kind::numbers},
    {"scene", Kind::integer},
    {"scenes", Kind::objects},
    {"skeleton", Kind::integer},
    {"skin", Kind::integer},
    {"skins", Kind::objects},
    {"source", Kind::integer},
    {"sparse", Kind::object},
    {"strength", Kind::number},
    {"target", Kind::integer | Kind::object},
    {"targets", Kind::objects},
    {"texCoord", Kind::integer},
    {"textures", Kind::objects},
    {"translation", Kind::numbers},
    {"type", Kind::text},
    {"uri", Kind::text},
    {"values", Kind::object},
    {"version", Kind::text},
    {"weights", Kind::numbers},
    {"wrapS", Kind::integer},
    {"wrapT", Kind::integer},
    {"xmag", Kind::number},
    {"yfov", Kind::number},
    {"ymag", Kind::number},
    {"zfar", Kind::number},
    {"znear", Kind::number},
};

unsigned expected_kinds(std::string_view key) {
  const auto it = std::lower_bound(std::begin(kSchema), std::end(kSchema), key,
                                   [](const KeyKind& k, std::string_view v) { return k.key < v; });
  return it != std::end(kSchema) && it->key == key ? it->kinds : 0;
}

bool is_integer_up_to(const json& value, double max) {
  return value.is_number_integer() && value.get<double>() >= 0 && value.get<double>() <= max;
}

template <typename Predicate>
bool all_of(const json& value, Predicate predicate) {
  return value.is_array() && std::all_of(value.begin(), value.end(), predicate);
}

bool matches(const json& value, unsigned kinds) {
  const auto is_index = [](const json& v) { return is_integer_up_to(v, 2147483647.0); };
  return ((kinds & Kind::integer) != 0 && is_index(value)) ||
         ((kinds & Kind::size) != 0 && is_integer_up_to(value, 1099511627776.0)) ||
         ((kinds & Kind::number) != 0 && value.is_number()) ||
         ((kinds & Kind::numbers) != 0 &&
          all_of(value, [](const json& v) { return v.is_number(); })) ||
         ((kinds & Kind::integers) != 0 && all_of(value, is_index)) ||
         ((kinds & Kind::text) != 0 && value.is_string()) ||
         ((kinds & Kind::flag) != 0 && value.is_boolean()) ||
         ((kinds & Kind::object) != 0 && value.is_object()) ||
         ((kinds & Kind::objects) != 0 &&
          all_of(value, [](const json& v) { return v.is_object(); }));
}

/// Required size of the array of numbers under `key`; 0: any size.
std::size_t expected_size(std::string_view key) {
  if (key == "matrix") return 16;
  if (key == "baseColorFactor" || key == "rotation") return 4;
  return key == "emissiveFactor" || key == "scale" || key == "translation" ? 3 : 0;
}

/// Properties without which tinygltf fails and does not say where.
struct Required {
  std::string_view section, inner;  // root array, and array within its elements
  std::array<std::string_view, 3> keys;
};

constexpr Required kRequired[] = {
    {"accessors", "", {"componentType", "count", "type"}},
    {"animations", "channels", {"sampler", "target", ""}},
    {"animations", "samplers", {"input", "output", ""}},
    {"bufferViews", "", {"buffer", "byteLength", ""}},
    {"cameras", "", {"type", "", ""}},
    {"meshes", "", {"primitives", "", ""}},
    {"meshes", "primitives", {"attributes", "", ""}},
    {"skins", "", {"joints", "", ""}},
};

void check_required(const JsonView& element, const Required& required, JsonFault& fault) {
  for (const std::string_view key : required.keys) {
    if (!key.empty() && !element[key].present()) {
      fault.report(element.path(), absl::StrCat("has no ", std::string(key)));
    }
  }
}

/// "2.1" as {2, 1}; nullopt if it is not a version.
std::optional<std::pair<int, int>> parse_version(const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, '.');
  std::pair<int, int> version;
  if (parts.size() != 2 || !absl::SimpleAtoi(parts[0], &version.first) ||
      !absl::SimpleAtoi(parts[1], &version.second)) {
    return std::nullopt;
  }
  return version;
}

/// Rejects files that need a reader of another version. Source: glTF 2.0, section 3.2.
void check_version(const JsonView& asset, JsonFault& fault) {
  for (const char* key : {"minVersion", "version"}) {
    const JsonView member = asset[key];
    if (!member.present() && key == std::string_view("minVersion")) continue;
    const auto version = parse_version(member.present() ? member.as_text() : "");
    const bool is_supported = version && version->first == 2 &&
                              (version->second == 0 || key == std::string_view("version"));
    if (!is_supported) {
      fault.report(absl::StrCat("asset.", key),
                   member.present()
                       ? absl::StrCat("\"", member.as_text(), "\" is not supported; only 2.0 is")
                       : "is missing; must be 2.0");
    }
  }
}

/// Checks the types of an accessor, with whose sizes tinygltf works.
void check_accessor_types(const JsonView& accessor, JsonFault& fault) {
  constexpr std::string_view kTypes[] = {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"};
  const std::string type = accessor.text("type");
  if (std::find(std::begin(kTypes), std::end(kTypes), type) == std::end(kTypes)) {
    fault.report(accessor.path() + ".type", "\"" + type + "\" is not defined by glTF");
  }
  const std::int64_t component = accessor.integer("componentType", std::int64_t{1} << 31);
  if (component < 5120 || component > 5126 || component == 5124) {
    fault.report(accessor.path(),
                 absl::StrCat("componentType ", component, " is not defined by glTF"));
  }
}

/// Checks kRequired, and values that tinygltf does not check or rejects without naming the element.
void check_core(const json& core, JsonFault& fault) {
  const JsonView root(core, "", fault);
  check_version(root["asset"], fault);
  for (const Required& required : kRequired) {
    for (const JsonView& element : root[required.section].items()) {
      if (required.inner.empty()) {
        check_required(element, required, fault);
        continue;
      }
      for (const JsonView& inner : element[required.inner].items()) {
        check_required(inner, required, fault);
      }
    }
  }
  for (const JsonView& view : root["bufferViews"].items()) {
    const std::int64_t stride = view.integer("byteStride", std::int64_t{1} << 31);
    if (stride >= 0 && (stride < 4 || stride > 252 || stride % 4 != 0)) {
      fault.report(view.path(),
                   absl::StrCat("byteStride ", stride, " is not a multiple of 4 from 4 to 252"));
    }
  }
  for (const JsonView& accessor : root["accessors"].items()) check_accessor_types(accessor, fault);
  for (const JsonView& camera : root["cameras"].items()) {
    const std::string type = camera.text("type");
    if (type != "perspective" && type != "orthographic") {
      fault.report(camera.path() + ".type", "is not perspective or orthographic");
    }
  }
}

std::string expected_text(unsigned kinds) {
  if ((kinds & (Kind::integer | Kind::size)) != 0) return "a non-negative integer in range";
  if ((kinds & Kind::number) != 0) return "a number";
  if ((kinds & Kind::numbers) != 0) return "an array of numbers";
  if ((kinds & Kind::objects) != 0) return "an array of objects";
  if ((kinds & Kind::integers) != 0) return "an array of non-negative integers in range";
  if ((kinds & Kind::text) != 0) return "a string";
  if ((kinds & Kind::flag) != 0) return "true or false";
  return "an object";
}

/// Converts whole numbers written as 3.0 to integers, as the specification allows.
json as_integer_if_whole(const json& value) {
  if (!value.is_number_float()) return value;
  const double number = value.get<double>();
  if (number >= -9e15 && number <= 9e15 &&
      number == static_cast<double>(static_cast<std::int64_t>(number))) {
    return static_cast<std::int64_t>(number);
  }
  return value;
}

/// Copies `value` without extensions and extras. Recursion depth is bounded by split_container().
json stripped(const json& value, const std::string& path, bool integers, JsonFault& fault) {
  if (value.is_object()) {
    json out = json::object();
    for (const auto& item : value.items()) {
      if (item.key() == "extensions" || item.key() == "extras") continue;
      const std::string where = path.empty() ? item.key() : path + "." + item.key();
      // Attribute names are chosen by the file; all members of `attributes` and targets are
      // indices.
      const bool attribute = integers && !item.value().is_structured();
      const unsigned kinds = attribute ? Kind::integer : expected_kinds(item.key());
      const bool whole = (kinds & (Kind::integer | Kind::size)) != 0;
      const json checked = whole ? as_integer_if_whole(item.value()) : json();
      const json& member = whole ? checked : item.value();
      if (kinds != 0 && !matches(member, kinds)) {
        fault.report(where, "must be " + expected_text(kinds));
        return out;
      }
      const std::size_t size = (kinds & Kind::numbers) != 0 ? expected_size(item.key()) : 0;
      if (size != 0 && member.is_array() && member.size() != size) {
        fault.report(where, absl::StrCat("must be ", size, " numbers"));
      }
      const bool inner = item.key() == "attributes" || item.key() == "targets";
      out[item.key()] = stripped(member, where, inner, fault);
    }
    return out;
  }
  if (!value.is_array()) return value;
  json out = json::array();
  for (std::size_t i = 0; i < value.size(); ++i) {
    if (!value[i].is_structured()) {
      out.push_back(value[i]);
    } else {
      out.push_back(stripped(value[i], absl::StrCat(path, "[", i, "]"), integers, fault));
    }
  }
  return out;
}

absl::StatusOr<std::span<const std::byte>> buffer_bytes(const JsonView& buffer,
                                                        const GltfContainer& container, bool first,
                                                        ResourceReader& reader, GltfModel& model) {
  const std::string uri = buffer.text("uri");
  const auto at_buffer = [&](const absl::Status& s) {
    return absl::Status(s.code(), absl::StrCat(buffer.path(), ": ", s.message()));
  };
  if (uri.empty()) {
    if (first && container.has_bin) return container.bin;
    return absl::InvalidArgumentError(
        absl::StrCat(buffer.path(), ": no uri, and the file has no binary chunk for it"));
  }
  if (is_data_uri(uri)) {
    auto data = decode_data_uri(uri);
    if (!data.ok()) return at_buffer(data.status());
    model.owned.push_back(*std::move(data));
    return std::span<const std::byte>(model.owned.back());
  }
  const auto path = relative_path(uri);
  if (!path.ok()) return at_buffer(path.status());
  const auto bytes = reader.read(*path);
  if (!bytes.ok()) return at_buffer(bytes.status());
  model.resources.push_back(*path);
  return *bytes;
}

bool is_fallback(const JsonView& buffer) {
  const JsonView extension = buffer.extension("EXT_meshopt_compression");
  return extension.present() && extension.boolean("fallback", false);
}

/// Bytes of a buffer; none if it is faulty.
std::span<const std::byte> resolve_buffer(const JsonView& buffer, const GltfContainer& container,
                                          bool first, JsonFault& fault, ResourceReader& reader,
                                          GltfModel& model) {
  const std::int64_t length = buffer.integer("byteLength", std::int64_t{1} << 40);
  if (is_fallback(buffer) && buffer.text("uri").empty()) return {};
  const auto bytes = buffer_bytes(buffer, container, first, reader, model);
  if (!bytes.ok()) {
    model.faults.add(buffer.path(), bytes.status());
  } else if (length < 1) {
    fault.report(buffer.path() + ".byteLength", "is missing or 0");
  } else if (static_cast<std::uint64_t>(length) > bytes->size()) {
    fault.report(buffer.path(), absl::StrCat("byteLength ", length, ", but the buffer has only ",
                                             bytes->size(), " bytes: truncated?"));
  } else {
    return bytes->first(static_cast<std::size_t>(length));
  }
  return {};
}

}  // namespace

absl::StatusOr<json> parse_json(std::string_view text) {
  try {
    json root = json::parse(text.begin(), text.end());
    if (!root.is_object()) return absl::InvalidArgumentError("JSON: the root is not an object");
    return root;
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("JSON: ", e.what()));
  }
}

absl::Status check_extensions(const json& root, GltfModel& model) {
  JsonFault fault;
  const JsonView view(root, "", fault);
  for (const JsonView& item : view["extensionsRequired"].items()) {
    const std::string name = item.as_text();
    model.extensions_required.push_back(name);
    if (!name.empty() && !is_known(name)) {
      return absl::UnimplementedError(
          absl::StrCat("extensionsRequired: ", name, " is not supported"));
    }
  }
  for (const JsonView& item : view["extensionsUsed"].items()) {
    const std::string name = item.as_text();
    model.extensions_used.push_back(name);
    if (!name.empty() && !is_known(name)) {
      model.problems.push_back({Problem::Severity::warning, "extensionsUsed",
                                name + " is not supported and is ignored"});
    }
  }
  if (!fault.status().ok()) return fault.status();
  return check_tessera_extensions(root);
}

absl::Status resolve_buffers(const json& root, const GltfContainer& container,
                             ResourceReader& reader, GltfModel& model) {
  JsonFault fault(model.faults);
  const std::vector<JsonView> buffers = JsonView(root, "", fault)["buffers"].items();
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    model.buffers.push_back(resolve_buffer(buffers[i], container, i == 0, fault, reader, model));
  }
  return fault.status();
}

namespace {

/// Replaces the faulty parts of a core model by the smallest valid ones, so that other indices stay
/// valid.
void replace_faulty_parts(const PartFaults& faults, json& core) {
  const json placeholders = {
      {"accessors", {{"componentType", 5126}, {"count", 1}, {"type", "SCALAR"}}},
      {"animations", {{"channels", json::array()}, {"samplers", json::array()}}},
      {"bufferViews", {{"buffer", 0}, {"byteLength", 1}}},
      {"cameras", {{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 1}}}}},
      {"materials", json::object()},
      {"meshes", {{"primitives", json::array()}}},
      {"samplers", json::object()},
      {"skins", {{"joints", {0}}}},
      {"textures", json::object()}};
  for (const auto& [section, placeholder] : placeholders.items()) {
    const auto parts = core.find(section);
    if (parts == core.end() || !parts->is_array()) continue;
    for (std::size_t i = 0; i < parts->size(); ++i) {
      if (faults.find(section, static_cast<std::int32_t>(i)) != nullptr) (*parts)[i] = placeholder;
    }
  }
}

}  // namespace

absl::StatusOr<std::string> core_text(const json& root, PartFaults& faults) {
  JsonFault fault(faults);
  const auto nodes = root.find("nodes");
  if (nodes != root.end() && nodes->is_array() && nodes->size() > kMaxNodes) {
    return absl::InvalidArgumentError(
        absl::StrCat("nodes: ", nodes->size(), ", more than the limit of ", kMaxNodes));
  }
  json core = json::object();
  for (const auto& item : root.items()) {
    if (item.key() == "buffers" || item.key() == "images") continue;
    if (item.key() == "extensions" || item.key() == "extras") continue;
    core[item.key()] = item.value();
  }
  core = stripped(core, "", false, fault);
  if (fault.status().ok()) check_core(core, fault);
  absl::Status valid = fault.status();
  if (!valid.ok()) return valid;
  if (!faults.empty()) replace_faulty_parts(faults, core);
  return core.dump();
}

}  // namespace tessera::render
