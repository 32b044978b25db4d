#include "tests/support/scene/gltf_builder.h"

#include <cstring>
#include <nlohmann/json.hpp>

namespace tessera::testing {

using nlohmann::json;

struct GltfBuilder::Parts {
  json root;
  std::vector<std::byte> data;
};

namespace {

constexpr std::size_t kAlignment = 4;

json parse(std::string_view text) {
  return json::parse(text.begin(), text.end());
}

void append_u32(std::string& out, std::size_t value) {
  const auto narrow = static_cast<std::uint32_t>(value);
  char bytes[4];
  std::memcpy(bytes, &narrow, 4);
  out.append(bytes, 4);
}

std::string padded(std::string text, char pad) {
  while (text.size() % kAlignment != 0) text.push_back(pad);
  return text;
}

}  // namespace

std::string base64(std::span<const std::byte> bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8 | (i + k < bytes.size() ? static_cast<std::uint32_t>(bytes[i + k]) : 0u);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out.push_back(i + k > bytes.size() ? '=' : kDigits[group >> (18 - 6 * k) & 63]);
    }
  }
  return out;
}

GltfBuilder::GltfBuilder() : parts_(std::make_unique<Parts>()) {
  parts_->root = parse(R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]})");
}

GltfBuilder::~GltfBuilder() = default;

int GltfBuilder::add(std::string_view section, std::string_view text) {
  json& array = parts_->root[std::string(section)];
  array.push_back(parse(text));
  return static_cast<int>(array.size()) - 1;
}

int GltfBuilder::add_view(std::span<const std::byte> bytes, int stride) {
  std::vector<std::byte>& data = parts_->data;
  while (data.size() % kAlignment != 0) data.push_back(std::byte{0});
  json view = {{"buffer", 0}, {"byteOffset", data.size()}, {"byteLength", bytes.size()}};
  if (stride != 0) view["byteStride"] = stride;
  data.insert(data.end(), bytes.begin(), bytes.end());
  json& array = parts_->root["bufferViews"];
  array.push_back(std::move(view));
  return static_cast<int>(array.size()) - 1;
}

int GltfBuilder::add_accessor(const AccessorSpec& spec) {
  json accessor = {
      {"componentType", spec.component_type}, {"count", spec.count}, {"type", spec.type}};
  if (spec.view >= 0) accessor["bufferView"] = spec.view;
  if (spec.normalized) accessor["normalized"] = true;
  if (spec.byte_offset != 0) accessor["byteOffset"] = spec.byte_offset;
  json& array = parts_->root["accessors"];
  array.push_back(std::move(accessor));
  return static_cast<int>(array.size()) - 1;
}

int GltfBuilder::add_floats(const char* type, const std::vector<float>& values) {
  const std::string_view name = type;
  const int components = name == "SCALAR" ? 1
                         : name == "VEC2" ? 2
                         : name == "VEC3" ? 3
                         : name == "MAT4" ? 16
                         : name == "MAT3" ? 9
                                          : 4;
  return add_accessor({.view = add_view(bytes_of(values)),
                       .count = static_cast<std::int64_t>(values.size()) / components,
                       .type = type});
}

int GltfBuilder::add_vec2(const std::vector<render::Vec2f>& values) {
  return add_accessor({.view = add_view(bytes_of(values)),
                       .count = static_cast<std::int64_t>(values.size()),
                       .type = "VEC2"});
}

int GltfBuilder::add_vec3(const std::vector<render::Vec3f>& values) {
  return add_accessor({.view = add_view(bytes_of(values)),
                       .count = static_cast<std::int64_t>(values.size()),
                       .type = "VEC3"});
}

int GltfBuilder::add_vec4(const std::vector<render::Vec4f>& values) {
  return add_accessor({.view = add_view(bytes_of(values)),
                       .count = static_cast<std::int64_t>(values.size()),
                       .type = "VEC4"});
}

int GltfBuilder::add_indices(const std::vector<std::uint32_t>& values) {
  return add_accessor({.view = add_view(bytes_of(values)),
                       .component_type = kUnsignedInt,
                       .count = static_cast<std::int64_t>(values.size())});
}

int GltfBuilder::add_mesh(const TriangleMesh& mesh) {
  json primitive = {{"attributes", {{"POSITION", add_vec3(mesh.positions)}}}};
  if (!mesh.normals.empty()) primitive["attributes"]["NORMAL"] = add_vec3(mesh.normals);
  if (!mesh.uv.empty()) primitive["attributes"]["TEXCOORD_0"] = add_vec2(mesh.uv);
  if (!mesh.indices.empty()) primitive["indices"] = add_indices(mesh.indices);
  if (mesh.material >= 0) primitive["material"] = mesh.material;
  return add("meshes", json({{"primitives", {primitive}}}).dump());
}

int GltfBuilder::add_node(std::string_view text, bool root) {
  const int node = add("nodes", text);
  if (root) parts_->root["scenes"][0]["nodes"].push_back(node);
  return node;
}

int GltfBuilder::add_node_with_mesh(int mesh, std::string_view extra) {
  json node = {{"mesh", mesh}};
  node.update(parse(extra));
  return add_node(node.dump());
}

int GltfBuilder::add_image(std::span<const std::byte> file, std::string_view mime) {
  json image = {{"bufferView", add_view(file)}};
  if (!mime.empty()) image["mimeType"] = std::string(mime);
  return add("images", image.dump());
}

int GltfBuilder::add_texture(int image, std::string_view sampler) {
  const int index = add("samplers", sampler);
  return add("textures", json({{"source", image}, {"sampler", index}}).dump());
}

void GltfBuilder::set(std::string_view pointer, std::string_view text) {
  parts_->root[json::json_pointer(std::string(pointer))] = parse(text);
}

void GltfBuilder::use_extension(std::string_view name, bool required) {
  parts_->root["extensionsUsed"].push_back(std::string(name));
  if (required) parts_->root["extensionsRequired"].push_back(std::string(name));
}

std::string GltfBuilder::gltf() const {
  json root = parts_->root;
  if (!parts_->data.empty()) {
    root["buffers"][0]["byteLength"] = parts_->data.size();
    root["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(parts_->data);
  }
  return root.dump();
}

std::string GltfBuilder::glb() const {
  json root = parts_->root;
  if (!parts_->data.empty()) root["buffers"][0]["byteLength"] = parts_->data.size();
  const std::string text = padded(root.dump(), ' ');
  std::string bin(parts_->data.size(), '\0');
  if (!bin.empty()) std::memcpy(bin.data(), parts_->data.data(), bin.size());
  bin = padded(std::move(bin), '\0');
  std::string out = "glTF";
  append_u32(out, 2);
  append_u32(out, 12 + 8 + text.size() + (bin.empty() ? 0 : 8 + bin.size()));
  append_u32(out, text.size());
  out += "JSON" + text;
  if (!bin.empty()) {
    append_u32(out, bin.size());
    out += std::string("BIN\0", 4) + bin;
  }
  return out;
}

TriangleMesh unit_quad(int material) {
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.uv = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  mesh.indices = {0, 1, 2, 0, 2, 3};
  mesh.material = material;
  return mesh;
}

}  // namespace tessera::testing
