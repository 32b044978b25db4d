#pragma once

#include <compare>
#include <cstdint>
#include <limits>

#include "worker/math/vector.h"

namespace tessera::render {

/// Names a triangle; ordered as the tie rule of "One hit" wants.
struct TriangleId {
  std::uint32_t instance = UINT32_MAX, primitive = UINT32_MAX, triangle = UINT32_MAX;
  auto operator<=>(const TriangleId&) const = default;
};

/// In TriangleId::triangle of a surface that a CSG solid shows from behind (its outside is inside
/// the operand, as after a subtraction). The rest is the triangle or face.
inline constexpr std::uint32_t kFlippedSide = 0x80000000u;

/// A world-space ray; the direction need not be unit. Hits have 0 <= t < t_max in multiples of it.
struct Ray {
  Vec3f origin, direction;
  float t_max = std::numeric_limits<float>::infinity();
  TriangleId leaves = {};  // the flat primitive it starts on, which it cannot hit again
  float time = 0;          // in [0, 1] of the shutter's, where anything moves
};

struct Hit {
  float t = 0;
  TriangleId id;
  float b0 = 0, b1 = 0, b2 = 0;  // barycentrics of the triangle's three vertices, sum 1 (rounded);
                                 // or on a shape (its face is the triangle) the point, object space
};

/// The order of "One hit": by t, then by id.
inline bool precedes(const Hit& a, const Hit& b) {
  return a.t < b.t || (a.t == b.t && a.id < b.id);
}

}  // namespace tessera::render
