#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Vertex attributes that the material of a primitive uses.
struct VertexUsage {
  std::array<bool, 2> uv = {false, false};
  bool tangents = false;            // it has a normal map
  std::int32_t tangent_uv_set = 0;  // UV set of that map
};

/// A primitive before morphing and skinning. Optional arrays are empty or as long as `positions`.
struct BasePrimitive {
  struct MorphTarget {
    std::vector<Vec3f> positions, normals, tangents;  // displacements
  };
  struct Influences {  // one JOINTS_n, WEIGHTS_n pair
    std::vector<std::array<std::uint16_t, 4>> joints;
    std::vector<Vec4f> weights;
  };
  Primitive primitive;  // material unset; normals and tangents have unit length
  std::vector<MorphTarget> targets;
  std::vector<Influences> influences;
};

/// Reads primitive `index` of `mesh` as triangles. Splits strips and fans with their winding,
/// checks indices, and generates missing tangents if needed. Returns nullopt, with a warning in
/// `problems`, for points, lines and primitives without positions. Errors: InvalidArgument
/// "meshes[i].primitives[k]: ...".
absl::StatusOr<std::optional<BasePrimitive>> read_primitive(const GltfModel& model,
                                                            std::int32_t mesh, std::size_t index,
                                                            const VertexUsage& usage,
                                                            std::vector<Problem>& problems);

/// Drops triangles with a vertex that is not finite or beyond kMaxCoordinate, and moves such
/// vertices to 0. Returns the number of dropped triangles.
std::size_t drop_invalid_triangles(Primitive& primitive);

/// Triangles of a list, strip or fan over `corners` (vertex indices in order); glTF 2.0
/// specification, section 3.7.2.1. An incomplete last triangle is dropped.
std::vector<std::array<std::uint32_t, 3>> assemble_triangles(
    PrimitiveMode mode, const std::vector<std::uint32_t>& corners);

}  // namespace tessera::render
