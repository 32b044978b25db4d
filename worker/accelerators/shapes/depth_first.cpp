#include "worker/accelerators/shapes/depth_first.h"

#include "worker/accel/binary_bvh/binary_bvh.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::uint32_t kLeafSize = 4;

/// Appends `node` and the nodes below it. The recursion is at most kMaxLevels deep.
void append(const BinaryBvh& bvh, const BinaryNode& node, DepthFirstTree& tree) {
  const std::size_t at = tree.nodes.size();
  const auto first = static_cast<std::uint32_t>(tree.order.size());
  tree.nodes.push_back({node.box, 0, first, 0});
  if (node.leaf()) {
    const auto begin = bvh.order.begin() + node.first;
    tree.order.insert(tree.order.end(), begin, begin + node.count);
  } else {
    append(bvh, bvh.nodes[node.left], tree);
    append(bvh, bvh.nodes[node.right], tree);
  }
  tree.nodes[at].skip = static_cast<std::uint32_t>(tree.nodes.size());
  tree.nodes[at].count = static_cast<std::uint32_t>(tree.order.size()) - first;
}

}  // namespace

DepthFirstTree build_depth_first(const ShapeBounds& shapes) {
  const BinaryBvh bvh = build_binary_bvh({shapes.boxes, kLeafSize}, sequential());
  DepthFirstTree tree;
  tree.nodes.reserve(bvh.nodes.size());
  tree.order.reserve(bvh.order.size());
  append(bvh, bvh.nodes[0], tree);
  return tree;
}

}  // namespace tessera::render::accelerators
