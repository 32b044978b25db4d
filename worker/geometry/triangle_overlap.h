#pragma once

#include <array>

#include "worker/math/vector.h"

namespace tessera::render {

using TriangleCorners = std::array<Vec3f, 3>;

/// Whether two triangles have more in common than neighbours do; exact. Corners with equal
/// coordinates are shared. Triangles overlap if they share
/// - three corners: always (the same triangle twice);
/// - two corners: if they lie in one plane, folded onto each other;
/// - one corner: if they meet elsewhere too;
/// - none: if they meet or touch.
/// Requires triangles whose corners are not collinear.
bool triangles_overlap(const TriangleCorners& first, const TriangleCorners& second);

}  // namespace tessera::render
