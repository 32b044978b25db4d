#pragma once

#include <array>
#include <vector>

#include "worker/light/tree/light_tree.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Corners of a triangle, recentred world.
using Corners = std::array<Vec3d, 3>;

/// Box, normal and, for the time being as `strength`, area of a triangle. Mirrored instances turn
/// the winding over, not the side that shines.
LightBounds bounds_of(const Corners& corners, bool mirrored);

/// Of a punctual light where `pose` has it.
LightBounds bounds_of(const PunctualLight& light, const PunctualPose& pose);

/// Around a light that has each of these bounds at some time: boxes and directions of all, the
/// strength of the strongest. Requires one at least.
LightBounds bounds_over(const std::vector<LightBounds>& poses);

}  // namespace tessera::render
