#pragma once

#include <cstdint>
#include <vector>

namespace tessera::contract {

struct GridPoint {
  std::int32_t x = 0, y = 0;
  bool operator==(const GridPoint&) const = default;
};

/// All cells of a width x height grid along a generalised Hilbert curve from (0, 0).
///
/// Every cell once; consecutive cells are edge neighbours, but for at most one diagonal step where
/// parity forces it (larger side even is never forced). Requires 1 <= width, height and
/// width * height <= 2^31. O(width * height) time, O(log) stack.
/// Source: J. Červený's "gilbert" construction, rewritten: halves along the longer side, thirds
/// of an L-shaped split otherwise.
std::vector<GridPoint> hilbert_curve(std::int32_t width, std::int32_t height);

}  // namespace tessera::contract
