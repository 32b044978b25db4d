#pragma once

#include "worker/geometry/shape.h"

namespace tessera::render {

/// Upper bound of dot(direction, p) over the points p of a shape (its support function). Exact for
/// boxes, ellipsoids, cylinders, discs and tori. Other surfaces of revolution are bounded by their
/// cylinder; general quadrics by their box and, if that is smaller, their ellipsoid; all other
/// shapes by their box.
double support(const Shape& shape, const Vec3d& direction);

}  // namespace tessera::render
