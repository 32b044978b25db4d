#pragma once

#include <cstddef>

#include "worker/math/vector.h"

namespace tessera::render {

/// Returns exactly which side of the plane through a, b, c the point d is on: 1 if a, b, c are
/// clockwise as seen from d, 0 if d is in the plane, else -1. Requires finite coordinates that are
/// zero or from 1e-38 to 1e18 in size. Source: J. Shewchuk, "Adaptive precision floating-point
/// arithmetic and fast robust geometric predicates", 1997 (error-free sums and products, without
/// the adaptive stages).
int side_of_plane(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Vec3f& d);

/// The same for the line through a and b and the point c, projected along `axis`.
int side_of_line(const Vec3f& a, const Vec3f& b, const Vec3f& c, int axis);

}  // namespace tessera::render
