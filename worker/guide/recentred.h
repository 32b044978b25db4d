#pragma once

#include <cmath>

#include "worker/math/vector.h"

namespace tessera::render {

/// A direction at a point, as seen from the centre of its cell.
struct Recentred {
  Vec3f direction;  // unit up to rounding
  float scale = 1;  // density over solid angle at the point per density at the centre
};

/// Where a ray from `offset` along `direction` (unit) leaves the sphere of `radius` around the
/// centre: light that comes from about that distance has the same recentred direction at all points
/// of a cell. Radius 0 stands for infinity. Requires |offset| < radius.
///
/// An area dA of the sphere that is seen at distance t and cosine c subtends c dA / t^2 at the
/// point and dA / radius^2 at the centre.
inline Recentred recentred(const Vec3f& offset, const Vec3f& direction, float radius) {
  if (!(radius > 0)) return {direction, 1};
  const float along = dot(offset, direction);
  const float root = std::sqrt(along * along + (radius * radius - dot(offset, offset)));
  const float t = root - along;
  return {(offset + direction * t) / radius, t * t / (radius * root)};
}

/// The inverse for a unit direction at the centre.
inline Vec3f direction_from(const Vec3f& offset, const Vec3f& at_centre, float radius) {
  return radius > 0 ? normalize(at_centre * radius - offset) : at_centre;
}

}  // namespace tessera::render
