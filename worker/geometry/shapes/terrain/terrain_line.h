#pragma once

#include <vector>

#include "worker/geometry/shape.h"

namespace tessera::render {

/// intersect_shape() for terrain. Requires an `origin` near the shape.
void intersect_terrain(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                       const HitRequest& request, std::vector<ShapeHit>& hits);

}  // namespace tessera::render
