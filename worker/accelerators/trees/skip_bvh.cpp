// A stackless BVH: nodes in depth-first order, each with the index at which to continue if the ray
// misses it. The order is fixed, so the nearer child may come last.
// Source: B. Smits, "Efficiency issues for ray tracing", 1998.

#include <utility>

#include "worker/accelerators/shapes/depth_first.h"
#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

class SkipBvh final : public ShapeIndex {
 public:
  explicit SkipBvh(DepthFirstTree tree) : tree_(std::move(tree)) {}

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    const auto end = static_cast<std::uint32_t>(tree_.nodes.size());
    for (std::uint32_t i = 0; i < end;) {
      const DepthFirstNode& node = tree_.nodes[i];
      float enter = 0;
      ++stats.nodes;
      if (!may_hit(ray.slabs, node.box, limit, enter)) {
        i = node.skip;
        continue;
      }
      for (std::uint32_t j = 0; tree_.leaf(i) && j < node.count; ++j) {
        if (visit(tree_.order[node.first + j])) return true;
      }
      ++i;
    }
    return false;
  }
  std::size_t memory_bytes() const override { return tree_.memory_bytes(); }

 private:
  DepthFirstTree tree_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_skip_bvh(const ShapeBounds& shapes) {
  return std::make_unique<SkipBvh>(build_depth_first(shapes));
}

}  // namespace tessera::render::accelerators
