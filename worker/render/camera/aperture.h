#pragma once

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A point of the lens, metres right of and above its centre.
struct AperturePoint {
  double x = 0, y = 0;
};

/// Maps `u` in [0, 1)^2 uniformly to the aperture: the disc of the lens's radius, or the regular
/// polygon inscribed in it whose first corner is at `blade_rotation` from the right.
AperturePoint aperture_point(const Lens& lens, Vec2f u);

/// Square metres.
double aperture_area(const Lens& lens);

bool is_in_aperture(const Lens& lens, const AperturePoint& point);

}  // namespace tessera::render
