#pragma once

#include <cmath>

#include "worker/math/vector.h"

/// The octahedral map between directions and the unit square: a direction is projected onto the
/// octahedron |x| + |y| + |z| = 1, whose lower half is folded outwards. Continuous, and without
/// trigonometric functions. Source: Engelhardt & Dachsbacher, "Octahedron environment maps", 2008.
namespace tessera::render::octahedral {

/// Point in [0, 1)^2 of a direction other than zero.
inline Vec2f square_of(const Vec3f& d) {
  const float sum = std::fabs(d.x) + std::fabs(d.y) + std::fabs(d.z);
  float a = d.x / sum, b = d.y / sum;
  if (d.z < 0) {
    const float folded = std::copysign(1 - std::fabs(b), a);
    b = std::copysign(1 - std::fabs(a), b);
    a = folded;
  }
  const auto unit = [](float x) { return clamp(0.5f * x + 0.5f, 0.0f, 1 - 0x1p-24f); };
  return {unit(a), unit(b)};
}

/// Unit direction of a point in [0, 1]^2.
inline Vec3f direction_of_square(const Vec2f& p) {
  float a = 2 * p.x - 1, b = 2 * p.y - 1;
  const float z = 1 - std::fabs(a) - std::fabs(b);
  if (z < 0) {
    const float folded = std::copysign(1 - std::fabs(b), a);
    b = std::copysign(1 - std::fabs(a), b);
    a = folded;
  }
  return normalize(Vec3f{a, b, z});
}

/// Density over solid angle, at a unit direction, of uniform points in the square. The square has
/// four times the area of the projected octahedron's (x, y); an area dA of the latter at distance r
/// from the centre subtends dA / r^3.
inline float density(const Vec3f& d) {
  const float r = 1 / (std::fabs(d.x) + std::fabs(d.y) + std::fabs(d.z));
  return 0.25f * (r * r * r);
}

}  // namespace tessera::render::octahedral
