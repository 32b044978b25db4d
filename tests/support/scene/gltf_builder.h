#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::testing {

/// glTF component types, for add_accessor().
enum ComponentType : int {
  kByte = 5120,
  kUnsignedByte = 5121,
  kShort = 5122,
  kUnsignedShort = 5123,
  kUnsignedInt = 5125,
  kFloat = 5126,
};

/// Description of an accessor for add_accessor().
struct AccessorSpec {
  int view = -1;
  int component_type = kFloat;
  std::int64_t count = 0;
  const char* type = "SCALAR";
  bool normalized = false;
  std::int64_t byte_offset = 0;
};

/// The parts of a mesh that most tests need.
struct TriangleMesh {
  std::vector<render::Vec3f> positions;
  std::vector<std::uint32_t> indices;  // empty: not indexed
  std::vector<render::Vec3f> normals;  // empty: none
  std::vector<render::Vec2f> uv;       // empty: none
  int material = -1;
};

/// Makes small glTF files in memory. JSON fragments are given as text, so that a test can write
/// invalid files too; every add_ function returns the new element's index.
///
///     GltfBuilder b;
///     const int m = b.add_material(R"({"emissiveFactor": [1, 1, 1]})");
///     b.add_node_with_mesh(b.add_mesh({.positions = {...}, .material = m}));
///     StatusOr<Scene> scene = load_and_pose(b, settings);
class GltfBuilder {
 public:
  GltfBuilder();
  ~GltfBuilder();
  GltfBuilder(const GltfBuilder&) = delete;
  GltfBuilder& operator=(const GltfBuilder&) = delete;

  /// A view of its own over `bytes`, 4-byte aligned. `stride` 0: not written.
  int add_view(std::span<const std::byte> bytes, int stride = 0);
  int add_accessor(const AccessorSpec& spec);

  int add_floats(const char* type, const std::vector<float>& values);
  int add_vec2(const std::vector<render::Vec2f>& values);
  int add_vec3(const std::vector<render::Vec3f>& values);
  int add_vec4(const std::vector<render::Vec4f>& values);
  int add_indices(const std::vector<std::uint32_t>& values);

  /// A mesh of one primitive from `mesh`.
  int add_mesh(const TriangleMesh& mesh);
  /// A node in the scene's roots that places `mesh`; `extra` is a JSON object merged into it.
  int add_node_with_mesh(int mesh, std::string_view extra = "{}");

  /// Appends the JSON object `text` to the root array `section` ("materials", "nodes", ...).
  int add(std::string_view section, std::string_view text);
  int add_material(std::string_view text) { return add("materials", text); }
  /// A node; `root` makes it one of scene 0's roots.
  int add_node(std::string_view text, bool root = true);
  /// An image in a buffer view; `mime` may be empty.
  int add_image(std::span<const std::byte> file, std::string_view mime);
  /// A texture with a sampler of its own from `sampler` (a JSON object).
  int add_texture(int image, std::string_view sampler = "{}");

  /// Sets the value at a JSON pointer ("/nodes/0/extensions/X") to `text`, making parents.
  void set(std::string_view pointer, std::string_view text);
  /// Adds `name` to extensionsUsed, and to extensionsRequired if `required`.
  void use_extension(std::string_view name, bool required = false);

  /// JSON with all data in one data URI.
  [[nodiscard]] std::string gltf() const;
  /// Binary glTF.
  [[nodiscard]] std::string glb() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// The bytes of a vector of plain values.
template <typename T>
std::span<const std::byte> bytes_of(const std::vector<T>& values) {
  return std::as_bytes(std::span<const T>(values));
}

/// RFC 4648 base64 with padding.
std::string base64(std::span<const std::byte> bytes);

/// The quad (0,0,0), (1,0,0), (1,1,0), (0,1,0) as two triangles, facing +z, uv = xy.
TriangleMesh unit_quad(int material = -1);

}  // namespace tessera::testing
