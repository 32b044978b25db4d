#pragma once

#include <cstdint>
#include <limits>
#include <utility>

#include "worker/geometry/bounds.h"
#include "worker/geometry/shape.h"

namespace tessera::render {

/// An end of a line segment, on a flat face of a box or on kCurvedFace.
struct LineEnd {
  double t;
  std::uint32_t face;
};

struct LineSegment {
  LineEnd first, last;
};

/// Clips the line origin + t direction to a box, whose planes may be at infinity. Returns false if
/// nothing is left.
inline bool clip_line(const Box3d& box, const Vec3d& origin, const Vec3d& direction,
                      LineSegment& inside) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  inside = {{-kInfinity, kCurvedFace}, {kInfinity, kCurvedFace}};
  for (int k = 0; k < 3; ++k) {
    if (direction[k] == 0) {
      if (!(origin[k] >= box.lo[k] && origin[k] <= box.hi[k])) return false;
      continue;
    }
    const auto face = static_cast<std::uint32_t>(1 + 2 * k);
    LineEnd near = {(box.lo[k] - origin[k]) / direction[k], face};
    LineEnd far = {(box.hi[k] - origin[k]) / direction[k], face + 1};
    if (direction[k] < 0) std::swap(near, far);
    if (near.t > inside.first.t) inside.first = near;
    if (far.t < inside.last.t) inside.last = far;
  }
  return inside.first.t <= inside.last.t;
}

/// The point at an end; exactly in the plane of a flat face.
inline Vec3d end_point(const Box3d& box, const Vec3d& origin, const Vec3d& direction,
                       const LineEnd& end) {
  Vec3d p = origin + direction * end.t;
  if (end.face == kCurvedFace) return p;
  const int axis = static_cast<int>(end.face - 1) / 2;
  p[axis] = end.face % 2 == 1 ? box.lo[axis] : box.hi[axis];
  return p;
}

}  // namespace tessera::render
