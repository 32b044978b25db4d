#pragma once

#include <cstdint>

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

}  // namespace tessera::render
