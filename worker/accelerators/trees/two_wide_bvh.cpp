// The readable reference of bounding volume hierarchies: two boxes a node, the nearer child first,
// by recursion. Source: T. Kay, J. Kajiya, "Ray tracing complex scenes", 1986; built by
// binary_bvh.h.

#include <utility>

#include "worker/accel/build/binary_bvh.h"
#include "worker/accelerators/trees/trees.h"

namespace tessera::render::reference {
namespace {

constexpr std::uint32_t kLeafSize = 4;

class TwoWideBvh final : public ShapeIndex {
 public:
  explicit TwoWideBvh(BinaryBvh bvh) : bvh_(std::move(bvh)) {}

  bool walk(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
            TraversalStats& work) const override {
    float enter = 0;
    return may_meet(ray.slabs, bvh_.nodes[0].box, limit, enter) &&
           descend(bvh_.nodes[0], {ray, limit, visit, work});
  }
  std::size_t memory_bytes() const override {
    return bvh_.nodes.capacity() * sizeof(BinaryNode) +
           bvh_.order.capacity() * sizeof(std::uint32_t);
  }

 private:
  struct Walk {
    const ShapeRay& ray;
    const float& limit;
    const ShapeVisitor& visit;
    TraversalStats& work;
  };

  bool descend(const BinaryNode& node, const Walk& walk) const {
    ++walk.work.nodes;
    if (node.leaf()) {
      for (std::uint32_t i = 0; i < node.count; ++i) {
        if (walk.visit(bvh_.order[node.first + i])) return true;
      }
      return false;
    }
    const BinaryNode* near = &bvh_.nodes[node.left];
    const BinaryNode* far = &bvh_.nodes[node.right];
    float near_enter = 0, far_enter = 0;
    bool meets_near = may_meet(walk.ray.slabs, near->box, walk.limit, near_enter);
    bool meets_far = may_meet(walk.ray.slabs, far->box, walk.limit, far_enter);
    if (meets_far && (!meets_near || far_enter < near_enter)) {
      std::swap(near, far);
      std::swap(meets_near, meets_far);
      std::swap(near_enter, far_enter);
    }
    if (meets_near && descend(*near, walk)) return true;
    return meets_far && far_enter <= walk.limit && descend(*far, walk);
  }

  BinaryBvh bvh_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_two_wide_bvh(const ShapeBounds& shapes) {
  const ParallelFor in_turn = [](std::int64_t count, const auto& body) {
    for (std::int64_t i = 0; i < count; ++i) body(i);
  };
  return std::make_unique<TwoWideBvh>(build_binary_bvh({shapes.boxes, kLeafSize}, in_turn));
}

}  // namespace tessera::render::reference
