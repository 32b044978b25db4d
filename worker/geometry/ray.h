#pragma once

#include <compare>
#include <cstdint>
#include <limits>

#include "worker/math/vector.h"

namespace tessera::render {

/// Identifies a triangle. Its order breaks ties between hits with equal t
/// (docs/explanation/determinism.md#closest-hit).
struct TriangleId {
  std::uint32_t instance = UINT32_MAX, primitive = UINT32_MAX, triangle = UINT32_MAX;
  auto operator<=>(const TriangleId&) const = default;
};

/// Set in TriangleId::triangle of a surface that a CSG solid shows from behind, as after a
/// subtraction: the solid's outside is inside the operand. The other bits are the triangle or face.
inline constexpr std::uint32_t kFlippedSide = 0x80000000u;

/// A ray in world space. t is in multiples of the direction, which need not be unit; hits have
/// 0 <= t < t_max.
struct Ray {
  Vec3f origin, direction;
  float t_max = std::numeric_limits<float>::infinity();
  TriangleId origin_triangle = {};  // the flat primitive it starts on and cannot hit again
  float time = 0;                   // fraction of the exposure, [0, 1]; used if anything moves
};

struct Hit {
  float t = 0;
  TriangleId id;
  // On a triangle: barycentrics of its vertices, with a rounded sum of 1. On a shape, whose face is
  // id.triangle: the point in object space.
  float b0 = 0, b1 = 0, b2 = 0;
};

/// The order of hits: by t, then by id.
inline bool precedes(const Hit& a, const Hit& b) {
  return a.t < b.t || (a.t == b.t && a.id < b.id);
}

}  // namespace tessera::render
