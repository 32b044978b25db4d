#pragma once

#include <cstdint>
#include <vector>

#include "tests/bench/accel/scenes.h"
#include "worker/geometry/ray.h"

namespace tessera::render::bench {

/// The triangle seen through each pixel's centre, by rasterising all triangles of a square view
/// into a z-buffer; TriangleId{} where there is none.
/// Source: H. Weghorst, G. Hooper, D. Greenberg, "Improved computational methods for ray tracing",
/// 1984.
std::vector<TriangleId> item_buffer(const BenchScene& bench, int side);

}  // namespace tessera::render::bench
