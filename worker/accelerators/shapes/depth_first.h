#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::reference {

/// A two-wide hierarchy laid out so that what is below a node follows it.
struct DepthFirstNode {
  Box3f box;
  std::uint32_t skip = 0;              // the next node that is not below this one
  std::uint32_t first = 0, count = 0;  // of DepthFirstTree::order: all shapes below
};

/// nodes[0] is the root. The children of nodes[i], unless it is a leaf, are nodes[i + 1] and that
/// one's `skip`.
struct DepthFirstTree {
  std::vector<DepthFirstNode> nodes;
  std::vector<std::uint32_t> order;

  bool leaf(std::uint32_t node) const { return nodes[node].skip == node + 1; }
  std::size_t memory_bytes() const {
    return nodes.capacity() * sizeof(DepthFirstNode) + order.capacity() * sizeof(std::uint32_t);
  }
};

/// Built by binary_bvh.h.
DepthFirstTree build_depth_first(const ShapeBounds& shapes);

/// What a walk carries down a tree.
struct DepthFirstWalk {
  const DepthFirstTree& tree;
  const float& limit;
  const ShapeVisitor& visit;
  TraversalStats& work;
};

/// Visits the shapes below a node that a ray meets, of two children those of the one it enters
/// first; true once a visit is. `meets(node, enter)` says whether the ray may meet a node within
/// the limit, and at which t (double) it enters it.
template <typename Meets>
bool walk_near_first(const DepthFirstWalk& walk, const Meets& meets, std::uint32_t index = 0) {
  ++walk.work.nodes;
  const DepthFirstTree& tree = walk.tree;
  if (tree.leaf(index)) {
    const DepthFirstNode& node = tree.nodes[index];
    for (std::uint32_t i = 0; i < node.count; ++i) {
      if (walk.visit(tree.order[node.first + i])) return true;
    }
    return false;
  }
  std::uint32_t near = index + 1, far = tree.nodes[near].skip;
  double near_enter = 0, far_enter = 0;
  bool meets_near = meets(near, near_enter), meets_far = meets(far, far_enter);
  if (meets_far && (!meets_near || far_enter < near_enter)) {
    std::swap(near, far);
    std::swap(meets_near, meets_far);
    std::swap(near_enter, far_enter);
  }
  if (meets_near && walk_near_first(walk, meets, near)) return true;
  return meets_far && far_enter <= double{walk.limit} && walk_near_first(walk, meets, far);
}

}  // namespace tessera::render::reference
