#pragma once

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A point of the lens, metres right of and above its middle.
struct AperturePoint {
  double x = 0, y = 0;
};

/// `u` in [0, 1)^2 to the aperture, uniformly over its area: the disc of the lens's radius, or the
/// regular polygon in it whose first corner lies `blade_rotation` from the right.
AperturePoint aperture_point(const Lens& lens, Vec2f u);

}  // namespace tessera::render
