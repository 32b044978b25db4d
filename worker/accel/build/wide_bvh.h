#pragma once

#include <cstdint>
#include <vector>

#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accel/layout/huge_array.h"
#include "worker/accel/layout/wide_node.h"

namespace tessera::render {

/// Items [first, first + count) of WideBvh::order.
struct BvhLeaf {
  std::uint32_t first = 0, count = 0;
};

/// A BVH whose nodes, leaves and items are in depth-first order. nodes[0] is
/// the root; without items it has no children.
template <int kWidth>
struct WideBvh {
  HugeArray<WideNode<kWidth>> nodes;
  std::vector<BvhLeaf> leaves;
  std::vector<std::uint32_t> order;
  Box3f bounds;
};

/// Collapses a binary tree into nodes with up to kWidth children. Chooses the nodes to keep so that
/// the sum of their areas is minimal.
/// Source: H. Ylitie, T. Karras, S. Laine, "Efficient incoherent ray traversal on GPUs through
/// compressed wide BVHs", 2017, section 3.1.
template <int kWidth>
WideBvh<kWidth> collapse(const BinaryBvh& binary);

extern template WideBvh<8> collapse<8>(const BinaryBvh& binary);
extern template WideBvh<16> collapse<16>(const BinaryBvh& binary);

}  // namespace tessera::render
