// A grid in which cells with many shapes contain grids of their own. Source: D. Jevans, B. Wyvill,
// "Adaptive voxel subdivision for ray tracing", 1989.

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "worker/accelerators/grids/grid.h"
#include "worker/accelerators/grids/grids.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::size_t kMaxCellShapes = 12;
constexpr int kLevels = 4;

Box3d intersection(const Box3d& a, const Box3d& b) {
  return {max(a.lo, b.lo), min(a.hi, b.hi)};
}

Box3d widened(const Box3d& box, double pad) {
  const Vec3d by = {pad, pad, pad};
  return {box.lo - by, box.hi + by};
}

class Level {
 public:
  /// Builds a grid over `region`, which must contain the relevant parts of the shapes.
  Level(std::span<const Box3f> boxes, std::vector<std::uint32_t> shapes, const Box3d& region,
        int levels)
      : shapes_(std::move(shapes)),
        grid_(region, shapes_.size()),
        cells_(grid_, boxes, shapes_),
        below_(grid_.cell_count(), 0) {
    if (levels <= 1) return;
    std::array<int, 3> cell{};
    for (cell[2] = 0; cell[2] < grid_.count(2); ++cell[2]) {
      for (cell[1] = 0; cell[1] < grid_.count(1); ++cell[1]) {
        for (cell[0] = 0; cell[0] < grid_.count(0); ++cell[0]) fill(boxes, cell, levels);
      }
    }
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                Mailbox& mailbox, TraversalStats& stats) const {
    if (!grid_.covers(ray)) return visit_all(shapes_, visit, mailbox);
    return traverse_cells(grid_, ray, limit, stats, [&](std::size_t cell) {
      const std::uint32_t below = below_[cell];
      return below == 0 ? visit_all(cells_.shapes_in(cell), visit, mailbox)
                        : levels_[below - 1]->traverse(ray, limit, visit, mailbox, stats);
    });
  }

  std::size_t memory_bytes() const {
    std::size_t sum = sizeof *this + cells_.memory_bytes() +
                      (shapes_.capacity() + below_.capacity()) * sizeof(std::uint32_t);
    for (const auto& level : levels_) sum += level->memory_bytes();
    return sum;
  }

 private:
  /// Builds a grid for a cell with many shapes, around the parts of their widened boxes in the
  /// cell. Builds none if more than half of the shapes are at least half as wide as the cell,
  /// because smaller cells would only multiply the references to them.
  void fill(std::span<const Box3f> boxes, const std::array<int, 3>& cell, int levels) {
    const auto members = cells_.shapes_in(grid_.index(cell));
    if (members.size() <= kMaxCellShapes) return;
    const Box3d box = grid_.cell_box(cell);
    const double width = max_component(box.hi - box.lo);
    const auto small = std::count_if(members.begin(), members.end(), [&](std::uint32_t shape) {
      return static_cast<double>(max_component(boxes[shape].hi - boxes[shape].lo)) < 0.5 * width;
    });
    if (2 * static_cast<std::size_t>(small) < members.size()) return;
    const Box3d region = intersection(box, widened(box_of(boxes, members), grid_.pad()));
    levels_.push_back(std::make_unique<Level>(
        boxes, std::vector<std::uint32_t>(members.begin(), members.end()), region, levels - 1));
    below_[grid_.index(cell)] = static_cast<std::uint32_t>(levels_.size());
  }

  std::vector<std::uint32_t> shapes_;
  Grid grid_;
  CellLists cells_;
  std::vector<std::uint32_t> below_;  // by cell: 1 + index in levels_; 0: no grid in the cell
  std::vector<std::unique_ptr<Level>> levels_;
};

class RecursiveGrid final : public ShapeIndex {
 public:
  explicit RecursiveGrid(const ShapeBounds& shapes)
      : top_(shapes.boxes, all_shapes(shapes.size()),
             {Vec3d(shapes.all().lo), Vec3d(shapes.all().hi)}, kLevels) {}

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    Mailbox mailbox;
    return top_.traverse(ray, limit, visit, mailbox, stats);
  }
  std::size_t memory_bytes() const override { return top_.memory_bytes(); }

 private:
  Level top_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_recursive_grid(const ShapeBounds& shapes) {
  return std::make_unique<RecursiveGrid>(shapes);
}

}  // namespace tessera::render::accelerators
