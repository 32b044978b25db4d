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

/// What a primitive's material asks of its vertices.
struct VertexNeeds {
  std::array<bool, 2> uv = {false, false};
  bool tangents = false;            // a normal map is read
  std::int32_t tangent_uv_set = 0;  // of that map
};

/// A primitive as the file has it, before morphing and skinning. Optional arrays are empty or as
/// long as `positions`.
struct BasePrimitive {
  struct MorphTarget {
    std::vector<Vec3f> positions, normals, tangents;  // displacements
  };
  struct Influences {  // one JOINTS_n, WEIGHTS_n pair
    std::vector<std::array<std::uint16_t, 4>> joints;
    std::vector<Vec4f> weights;
  };
  Primitive primitive;  // material unset; normals and tangents unit
  std::vector<MorphTarget> targets;
  std::vector<Influences> influences;
};

/// Reads primitive `index` of `mesh` as triangles: strips and fans taken apart with their winding,
/// indices checked, tangents generated where needed and absent. nullopt, with a warning in
/// `problems`, for points, lines and primitives without positions.
/// Errors: InvalidArgument "meshes[i].primitives[k]: ...".
absl::StatusOr<std::optional<BasePrimitive>> read_primitive(const GltfModel& document,
                                                            std::int32_t mesh, std::size_t index,
                                                            const VertexNeeds& needs,
                                                            std::vector<Problem>& problems);

/// Drops triangles with a vertex that is not finite or beyond kMaxCoordinate, moves such vertices
/// to 0 and returns how many triangles went.
std::size_t drop_wild_triangles(Primitive& primitive);

/// Triangles of a list, strip or fan over `corners` (vertex numbers in order); the specification's
/// section 3.7.2.1. An incomplete last triangle is left out.
std::vector<std::array<std::uint32_t, 3>> assemble_triangles(
    PrimitiveMode mode, const std::vector<std::uint32_t>& corners);

}  // namespace tessera::render
