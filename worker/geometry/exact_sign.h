#pragma once

#include <cstddef>

#include "worker/math/vector.h"

namespace tessera::render {

/// -1, 0 or 1: which side of the plane through a, b, c the point d is on, exactly. Positive where
/// a, b, c turn clockwise seen from d. Requires finite coordinates, zero or from 1e-38 to 1e18 in
/// size. Source: J. Shewchuk, "Adaptive precision floating-point arithmetic and fast robust
/// geometric predicates", 1997 (error-free sums and products, without the adaptive stages).
int side_of_plane(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Vec3f& d);

/// The same for the line through a and b and the point c, seen along `axis`.
int side_of_line(const Vec3f& a, const Vec3f& b, const Vec3f& c, int axis);

}  // namespace tessera::render
