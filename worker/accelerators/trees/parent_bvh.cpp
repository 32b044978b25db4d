// A stackless BVH that, unlike skip pointers, visits the nearer child first: each node knows its
// parent and its sibling, so a finished node leads to the farther sibling or back up. Which child
// is nearer follows from the ray's direction along the axis on which their centres differ most, so
// that the question has the same answer on the way up. Source: M. Hapala, T. Davidovic, I. Wald,
// V. Havran, P. Slusallek, "Efficient stack-less BVH traversal for ray tracing", 2011.

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "worker/accelerators/shapes/depth_first.h"
#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

struct Links {
  std::uint32_t parent = 0, sibling = 0;
  std::int8_t axis = 0;         // along which the centres of the children differ most
  bool first_is_lower = false;  // the first child's centre comes first on the axis
};

class ParentBvh final : public ShapeIndex {
 public:
  explicit ParentBvh(DepthFirstTree tree) : tree_(std::move(tree)), links_(tree_.nodes.size()) {
    for (std::uint32_t i = 0; i < links_.size(); ++i) {
      if (!tree_.leaf(i)) link_children(i);
    }
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    for (std::uint32_t node = 0;;) {
      float enter = 0;
      ++stats.nodes;
      const bool hits = may_hit(ray.slabs, tree_.nodes[node].box, limit, enter);
      if (hits && !tree_.leaf(node)) {
        node = near_child(node, ray);
        continue;
      }
      if (hits && visit_leaf(tree_.nodes[node], visit)) return true;
      if (!leave(node, ray)) return false;
    }
  }
  std::size_t memory_bytes() const override {
    return tree_.memory_bytes() + links_.capacity() * sizeof(Links);
  }

 private:
  void link_children(std::uint32_t parent) {
    const std::uint32_t first = parent + 1, second = tree_.nodes[first].skip;
    const Box3f &a = tree_.nodes[first].box, &b = tree_.nodes[second].box;
    float widest = -1;
    for (int k = 0; k < 3; ++k) {  // twice the distance of the centres
      const float apart = (b.lo[k] + b.hi[k]) - (a.lo[k] + a.hi[k]);
      if (!(std::fabs(apart) > widest)) continue;
      widest = std::fabs(apart);
      links_[parent].axis = static_cast<std::int8_t>(k);
      links_[parent].first_is_lower = apart >= 0;
    }
    links_[first].parent = links_[second].parent = parent;
    links_[first].sibling = second;
    links_[second].sibling = first;
  }
  std::uint32_t near_child(std::uint32_t parent, const ShapeRay& ray) const {
    const Links& links = links_[parent];
    const bool forward = ray.box_direction[links.axis] >= 0;
    return forward == links.first_is_lower ? parent + 1 : tree_.nodes[parent + 1].skip;
  }
  /// Moves from a finished node to the farther sibling of it, or of the first node above that is
  /// the nearer child. Returns false if all is done.
  bool leave(std::uint32_t& node, const ShapeRay& ray) const {
    while (node != 0) {
      const Links& links = links_[node];
      if (node == near_child(links.parent, ray)) {
        node = links.sibling;
        return true;
      }
      node = links.parent;
    }
    return false;
  }
  bool visit_leaf(const DepthFirstNode& leaf, const ShapeVisitor& visit) const {
    for (std::uint32_t i = 0; i < leaf.count; ++i) {
      if (visit(tree_.order[leaf.first + i])) return true;
    }
    return false;
  }

  DepthFirstTree tree_;
  std::vector<Links> links_;  // by node; parent and sibling of the root are unused
};

}  // namespace

std::unique_ptr<ShapeIndex> build_parent_bvh(const ShapeBounds& shapes) {
  return std::make_unique<ParentBvh>(build_depth_first(shapes));
}

}  // namespace tessera::render::accelerators
