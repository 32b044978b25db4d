// One grid per size class of shapes, so that large shapes are not registered in the many small
// cells that small shapes need. The grids are traversed one after the other, the one with the
// smallest shapes first. Source: F. Cazals, G. Drettakis, C. Puech, "Filtering, clustering and
// hierarchy construction: a new solution for ray-tracing complex scenes", 1995 (the filtering by
// size).

#include <algorithm>
#include <bit>
#include <map>
#include <utility>
#include <vector>

#include "worker/accelerators/grids/grid.h"
#include "worker/accelerators/grids/grids.h"

namespace tessera::render::accelerators {
namespace {

/// The sizes in one grid differ by less than a factor of 2^kSizeBits.
constexpr std::uint32_t kSizeBits = 3;
/// A size class with fewer than 1 / kMinShare of the shapes is merged into the next larger one.
constexpr std::size_t kMinShare = 256;

class HierarchicalGrid final : public ShapeIndex {
 public:
  explicit HierarchicalGrid(const ShapeBounds& shapes) {
    std::map<std::uint32_t, std::vector<std::uint32_t>> by_size;
    for (std::uint32_t i = 0; i < shapes.size(); ++i) {
      const float size = max_component(shapes.boxes[i].hi - shapes.boxes[i].lo);
      by_size[(std::bit_cast<std::uint32_t>(size) >> 23) / kSizeBits].push_back(i);
    }
    std::vector<std::uint32_t> pending;
    for (auto& [size, members] : by_size) {
      pending.insert(pending.end(), members.begin(), members.end());
      if (pending.size() < shapes.size() / kMinShare && size != by_size.rbegin()->first) continue;
      grids_.emplace_back(shapes.boxes, std::exchange(pending, {}));
    }
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    Mailbox mailbox;
    return std::any_of(grids_.begin(), grids_.end(), [&](const UniformGrid& grid) {
      return grid.traverse(ray, limit, visit, mailbox, stats);
    });
  }
  std::size_t memory_bytes() const override {
    std::size_t sum = 0;
    for (const UniformGrid& grid : grids_) sum += grid.memory_bytes();
    return sum;
  }

 private:
  std::vector<UniformGrid> grids_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_hierarchical_grid(const ShapeBounds& shapes) {
  return std::make_unique<HierarchicalGrid>(shapes);
}

}  // namespace tessera::render::accelerators
