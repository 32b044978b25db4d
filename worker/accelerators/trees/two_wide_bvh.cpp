// A plain BVH: two boxes per node, recursive traversal, the nearer child first. Built by
// build_binary_bvh(). Source: T. Kay, J. Kajiya, "Ray tracing complex scenes", 1986.

#include "worker/accelerators/trees/two_wide_bvh.h"

#include <utility>

#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

class TwoWideBvh final : public ShapeIndex {
 public:
  explicit TwoWideBvh(BinaryBvh bvh) : bvh_(std::move(bvh)) {}

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    float enter = 0;
    return may_hit(ray.slabs, bvh_.nodes[0].box, limit, enter) &&
           descend(bvh_.nodes[0], {ray, limit, visit, stats});
  }
  std::size_t memory_bytes() const override {
    return bvh_.nodes.capacity() * sizeof(BinaryNode) +
           bvh_.order.capacity() * sizeof(std::uint32_t);
  }

 private:
  struct Traversal {
    const ShapeRay& ray;
    const float& limit;
    const ShapeVisitor& visit;
    TraversalStats& stats;
  };

  bool descend(const BinaryNode& node, const Traversal& traversal) const {
    ++traversal.stats.nodes;
    if (node.leaf()) {
      for (std::uint32_t i = 0; i < node.count; ++i) {
        if (traversal.visit(bvh_.order[node.first + i])) return true;
      }
      return false;
    }
    const BinaryNode* near = &bvh_.nodes[node.left];
    const BinaryNode* far = &bvh_.nodes[node.right];
    float near_enter = 0, far_enter = 0;
    bool hits_near = may_hit(traversal.ray.slabs, near->box, traversal.limit, near_enter);
    bool hits_far = may_hit(traversal.ray.slabs, far->box, traversal.limit, far_enter);
    if (hits_far && (!hits_near || far_enter < near_enter)) {
      std::swap(near, far);
      std::swap(hits_near, hits_far);
      std::swap(near_enter, far_enter);
    }
    if (hits_near && descend(*near, traversal)) return true;
    return hits_far && far_enter <= traversal.limit && descend(*far, traversal);
  }

  BinaryBvh bvh_;
};

}  // namespace

std::unique_ptr<ShapeIndex> make_two_wide_bvh(BinaryBvh bvh) {
  return std::make_unique<TwoWideBvh>(std::move(bvh));
}

std::unique_ptr<ShapeIndex> build_two_wide_bvh(const ShapeBounds& shapes) {
  return make_two_wide_bvh(build_binary_bvh({shapes.boxes, kTwoWideLeafSize}, sequential()));
}

}  // namespace tessera::render::accelerators
