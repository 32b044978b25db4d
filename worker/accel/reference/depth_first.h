#pragma once

#include <cstdint>
#include <vector>

#include "worker/accel/reference/shapes.h"

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

}  // namespace tessera::render::reference
