#pragma once

#include <cstdint>
#include <vector>

#include "tests/bench/accel/workload/scenes.h"
#include "worker/geometry/ray.h"

namespace tessera::render::bench {

/// A z-buffer of triangle numbers.
struct ItemBuffer {
  std::vector<TriangleId> items;  // visible at each pixel's centre, or TriangleId{}; row-major
  std::int64_t fragments = 0;     // pixel centres covered, summed over the triangles
};

/// Rasterises all triangles of a square view. Source: H. Weghorst, G. Hooper, D. Greenberg,
/// "Improved computational methods for ray tracing", 1984.
ItemBuffer item_buffer(const BenchScene& bench, int side);

}  // namespace tessera::render::bench
