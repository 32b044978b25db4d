#pragma once

#include <cstdint>
#include <vector>

namespace tessera::contract {

struct GridPoint {
  std::int32_t x = 0, y = 0;
  bool operator==(const GridPoint&) const = default;
};

/// Returns all cells of a width x height grid along a generalised Hilbert curve from (0, 0).
///
/// Each cell occurs once. Consecutive cells share an edge, except for at most one diagonal step
/// that parity may force (never if the larger side is even). Requires 1 <= width, height and width
/// * height <= 2^31. O(width * height) time, O(log) stack. Source: J. Červený's "gilbert"
/// construction, rewritten: halves along the longer side, thirds of an L-shaped split otherwise.
std::vector<GridPoint> hilbert_curve(std::int32_t width, std::int32_t height);

}  // namespace tessera::contract
