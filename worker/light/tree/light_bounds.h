#pragma once

#include <array>
#include <vector>

#include "worker/light/tree/light_tree.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Vertices of a triangle, recentred world.
using Corners = std::array<Vec3d, 3>;

/// Bounds of a triangle, with its area as `strength` for now. Mirrored instances reverse the
/// winding, but not the emitting side.
LightBounds bounds_of(const Corners& corners, bool mirrored);

/// Bounds of a punctual light at `pose`.
LightBounds bounds_of(const PunctualLight& light, const PunctualPose& pose);

/// Bounds of a light that has each of `poses` at some time: union of boxes and directions, and
/// maximum strength. Requires at least one.
LightBounds bounds_over(const std::vector<LightBounds>& poses);

}  // namespace tessera::render
