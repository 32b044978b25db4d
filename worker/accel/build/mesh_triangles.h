#pragma once

#include <array>
#include <cstdint>

#include "worker/geometry/bounds.h"
#include "worker/geometry/motion.h"
#include "worker/geometry/triangle.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Calls visit(primitive, triangle, v0, v1, v2) for each triangle of the mesh that can be hit, in
/// id order.
template <typename Visit>
void for_each_triangle(const Mesh& mesh, Visit&& visit) {
  for (std::uint32_t p = 0; p < mesh.primitives.size(); ++p) {
    const Primitive& primitive = mesh.primitives[p];
    for (std::uint32_t t = 0; t < primitive.triangles.size(); ++t) {
      const auto& [i0, i1, i2] = primitive.triangles[t];
      const Vec3f &v0 = primitive.positions[i0], &v1 = primitive.positions[i1],
                  &v2 = primitive.positions[i2];
      if (is_hittable(v0, v1, v2)) visit(p, t, v0, v1, v2);
    }
  }
}

/// A triangle at two successive keyframes, which are equal if its mesh does not deform.
struct MovingTriangle {
  std::array<Vec3f, 3> from, to;

  std::array<Vec3f, 3> at(float f) const {
    return {lerp_bounded(from[0], to[0], f), lerp_bounded(from[1], to[1], f),
            lerp_bounded(from[2], to[2], f)};
  }
  /// Returns a box that contains the triangle at all times between the keyframes.
  Box3f box() const {
    Box3f box;
    for (std::size_t i = 0; i < 3; ++i) {
      box.extend(from[i]);
      box.extend(to[i]);
    }
    return box;
  }
};

/// Calls visit(primitive, triangle, MovingTriangle) for each triangle that can be hit at the
/// keyframe `segment` or the next.
template <typename Visit>
void for_each_triangle(const Mesh& mesh, std::uint32_t segment, Visit&& visit) {
  for (std::uint32_t p = 0; p < mesh.primitives.size(); ++p) {
    const Primitive& primitive = mesh.primitives[p];
    const bool moves = !mesh.keys.empty();
    const std::vector<Vec3f>& from = moves ? mesh.keys[segment][p].positions : primitive.positions;
    const std::vector<Vec3f>& to =
        moves ? mesh.keys[segment + 1][p].positions : primitive.positions;
    for (std::uint32_t t = 0; t < primitive.triangles.size(); ++t) {
      const auto& [i0, i1, i2] = primitive.triangles[t];
      const MovingTriangle triangle = {{from[i0], from[i1], from[i2]}, {to[i0], to[i1], to[i2]}};
      const auto hittable = [](const std::array<Vec3f, 3>& v) {
        return is_hittable(v[0], v[1], v[2]);
      };
      if (hittable(triangle.from) || hittable(triangle.to)) visit(p, t, triangle);
    }
  }
}

/// Returns a box that contains, during the whole exposure, the shape or all triangles that can be
/// hit.
inline Box3f bounds_of(const Mesh& mesh) {
  Box3f box;
  if (mesh.shape != nullptr) return mesh.shape->bounds;
  const std::size_t segments = mesh.keys.empty() ? 1 : mesh.keys.size() - 1;
  for (std::uint32_t s = 0; s < segments; ++s) {
    for_each_triangle(mesh, s, [&](std::uint32_t, std::uint32_t, const MovingTriangle& triangle) {
      box.extend(triangle.box());
    });
  }
  return box;
}

}  // namespace tessera::render
