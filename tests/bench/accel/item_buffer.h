#pragma once

#include <cstdint>
#include <vector>

#include "tests/bench/accel/scenes.h"
#include "worker/geometry/ray.h"

namespace tessera::render::bench {

/// Returns the triangle visible at each pixel's centre, or TriangleId{}, by rasterising all
/// triangles of a square view into a z-buffer. Source: H. Weghorst, G. Hooper, D. Greenberg,
/// "Improved computational methods for ray tracing", 1984.
std::vector<TriangleId> item_buffer(const BenchScene& bench, int side);

}  // namespace tessera::render::bench
