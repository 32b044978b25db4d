#pragma once

#include <cstdint>

#include "worker/geometry/shapes/shape.h"
#include "worker/scene/scene.h"

namespace tessera::testing {

/// A shape's surface as triangles with their corners on it: `n` to a side of a terrain, of a flat
/// face and across a height, 2 n around. Its distance from the shape falls with the square of n.
/// Quadrics that are not of revolution about y must be boxes, or closed and star-shaped as seen
/// from the origin, as blobs must.
render::Primitive tessellated(const render::Shape& shape, std::uint32_t n);

}  // namespace tessera::testing
