#pragma once

#include <array>

#include "worker/math/vector.h"

namespace tessera::render {

using TriangleCorners = std::array<Vec3f, 3>;

/// Whether two triangles have points in common other than those that being neighbours gives them,
/// exactly: corners are the same where their coordinates are.
/// - Three shared corners: always (the same triangle twice).
/// - An edge: if they lie folded onto each other in one plane.
/// - One corner: if they meet anywhere else too.
/// - None: if they meet at all, touching included.
/// Requires triangles whose corners are not on one line.
bool triangles_overlap(const TriangleCorners& first, const TriangleCorners& second);

}  // namespace tessera::render
