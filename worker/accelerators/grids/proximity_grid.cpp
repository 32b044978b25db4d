// A uniform grid whose empty cells store the distance to the nearest occupied cell, so that a ray
// skips empty space. Source: D. Cohen, Z. Sheffer, "Proximity clouds: an acceleration technique for
// 3D grid traversal", 1994 (with the chessboard distance).

#include <algorithm>
#include <cstdint>
#include <vector>

#include "worker/accelerators/grids/grid.h"
#include "worker/accelerators/grids/grids.h"

namespace tessera::render::accelerators {
namespace {

constexpr int kMaxDistance = 255;

/// Computes chessboard distances to the nearest occupied cell, exact up to kMaxDistance, in one
/// forward and one backward pass over the grid. Each pass uses the 13 neighbours that it has
/// already visited.
std::vector<std::uint8_t> distances(const UniformGrid& grid) {
  const Grid& g = grid.grid();
  std::vector<std::uint8_t> out(g.cell_count());
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = grid.cells().shapes_in(i).empty() ? kMaxDistance : 0;
  const auto relax = [&](const std::array<int, 3>& cell, int direction) {
    std::uint8_t& own = out[g.index(cell)];
    for (int n = 0; n < 13; ++n) {  // half of the 26 neighbours
      const std::array<int, 3> other = {cell[0] + direction * (n % 3 - 1),
                                        cell[1] + direction * (n / 3 % 3 - 1),
                                        cell[2] + direction * (n / 9 - 1)};
      bool inside = true;
      for (std::size_t k = 0; k < 3; ++k) {
        inside = inside && other[k] >= 0 && other[k] < g.count(static_cast<int>(k));
      }
      if (!inside) continue;
      own = static_cast<std::uint8_t>(std::min<int>(own, out[g.index(other)] + 1));
    }
  };
  const auto count = static_cast<std::int64_t>(out.size());
  for (const int direction : {1, -1}) {
    for (std::int64_t i = 0; i < count; ++i) {
      const std::int64_t at = direction > 0 ? i : count - 1 - i;
      relax({static_cast<int>(at % g.count(0)), static_cast<int>(at / g.count(0) % g.count(1)),
             static_cast<int>(at / g.count(0) / g.count(1))},
            direction);
    }
  }
  return out;
}

class ProximityGrid final : public ShapeIndex {
 public:
  explicit ProximityGrid(const ShapeBounds& shapes)
      : grid_(shapes.boxes, all_shapes(shapes.size())), distances_(distances(grid_)) {}

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    const Grid& grid = grid_.grid();
    Mailbox mailbox;
    if (!grid.covers(ray)) return visit_all(grid_.shapes(), visit, mailbox);
    const Segment part = grid.inside(ray, limit);
    if (part.empty()) return false;
    GridTraversal traversal(grid, ray, part.first);
    bool inside = true;
    while (inside) {
      ++stats.nodes;
      const std::size_t index = grid.index(traversal.cell());
      if (visit_all(grid_.cells().shapes_in(index), visit, mailbox)) return true;
      if (static_cast<double>(limit) < traversal.exit()) return false;
      const int distance = distances_[index];
      inside = distance > 1 ? traversal.skip(distance) : traversal.next();
    }
    return false;
  }
  std::size_t memory_bytes() const override { return grid_.memory_bytes() + distances_.capacity(); }

 private:
  UniformGrid grid_;
  std::vector<std::uint8_t> distances_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_proximity_grid(const ShapeBounds& shapes) {
  return std::make_unique<ProximityGrid>(shapes);
}

}  // namespace tessera::render::accelerators
