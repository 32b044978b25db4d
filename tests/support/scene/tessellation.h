#pragma once

#include <cstdint>

#include "worker/geometry/shape.h"
#include "worker/scene/scene.h"

namespace tessera::testing {

/// Tessellates a shape's surface with vertices on it: `n` cells per side of a terrain, of a flat
/// face and per height, 2 n around. Its distance from the shape falls with the square of n.
/// Quadrics that are not surfaces of revolution about y must be boxes, or closed and star-shaped
/// about the origin, and blobs must be star-shaped.
render::Primitive tessellated(const render::Shape& shape, std::uint32_t n);

}  // namespace tessera::testing
