#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

/// Node of a binary hierarchy in depth-first order: the nodes below a node follow it.
struct DepthFirstNode {
  Box3f box;
  std::uint32_t skip = 0;              // index of the next node that is not below this one
  std::uint32_t first = 0, count = 0;  // range of DepthFirstTree::order: all shapes below
};

/// nodes[0] is the root. The children of an inner node nodes[i] are nodes[i + 1] and
/// nodes[nodes[i + 1].skip].
struct DepthFirstTree {
  std::vector<DepthFirstNode> nodes;
  std::vector<std::uint32_t> order;

  bool leaf(std::uint32_t node) const { return nodes[node].skip == node + 1; }
  std::size_t memory_bytes() const {
    return nodes.capacity() * sizeof(DepthFirstNode) + order.capacity() * sizeof(std::uint32_t);
  }
};

/// Builds the tree with build_binary_bvh().
DepthFirstTree build_depth_first(const ShapeBounds& shapes);

/// Arguments of a traversal that do not change during it.
struct DepthFirstTraversal {
  const DepthFirstTree& tree;
  const float& limit;
  const ShapeVisitor& visit;
  TraversalStats& stats;
};

/// Visits the shapes below a node that a ray hits, beginning with the child that the ray enters
/// first. Stops and returns true when a visit returns true. `hits(node, enter)` returns
/// whether the ray may hit a node within the limit and sets the t (double) at which it enters.
template <typename Hits>
bool traverse_near_first(const DepthFirstTraversal& traversal, const Hits& hits,
                         std::uint32_t index = 0) {
  ++traversal.stats.nodes;
  const DepthFirstTree& tree = traversal.tree;
  if (tree.leaf(index)) {
    const DepthFirstNode& node = tree.nodes[index];
    for (std::uint32_t i = 0; i < node.count; ++i) {
      if (traversal.visit(tree.order[node.first + i])) return true;
    }
    return false;
  }
  std::uint32_t near = index + 1, far = tree.nodes[near].skip;
  double near_enter = 0, far_enter = 0;
  bool hits_near = hits(near, near_enter), hits_far = hits(far, far_enter);
  if (hits_far && (!hits_near || far_enter < near_enter)) {
    std::swap(near, far);
    std::swap(hits_near, hits_far);
    std::swap(near_enter, far_enter);
  }
  if (hits_near && traverse_near_first(traversal, hits, near)) return true;
  return hits_far && far_enter <= double{traversal.limit} &&
         traverse_near_first(traversal, hits, far);
}

}  // namespace tessera::render::accelerators
