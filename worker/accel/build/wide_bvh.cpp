#include "worker/accel/build/wide_bvh.h"

#include <algorithm>
#include <array>
#include <limits>

namespace tessera::render {
namespace {

/// Minimum costs of the subtrees of a binary tree, by the number of slots that they may take.
template <int kWidth>
class Costs {
 public:
  explicit Costs(const BinaryBvh& binary) : binary_(binary), costs_(binary.nodes.size()) {
    for (std::size_t i = binary.nodes.size(); i-- > 0;) {  // children come after their parents
      const BinaryNode& node = binary.nodes[i];
      auto& cost = costs_[i];
      const auto area = static_cast<float>(node.box.half_area());
      if (node.leaf()) {
        cost.fill(area);
        continue;
      }
      for (int slots = 2; slots < kWidth; ++slots) {
        cost[slots] = children_cost(node, slots);
        if (slots > 2) cost[slots] = std::min(cost[slots], cost[slots - 1]);
      }
      cost[1] = area + std::min(children_cost(node, kWidth), cost[kWidth - 1]);
      for (int slots = 2; slots < kWidth; ++slots) cost[slots] = std::min(cost[slots], cost[1]);
    }
  }

  /// Finds the nodes that become children of `index` if it becomes a node of the wide tree.
  void children_of(std::uint32_t index, std::vector<std::uint32_t>& children) const {
    const BinaryNode& node = binary_.nodes[index];
    children.clear();
    int slots = kWidth;
    while (slots > 2 && children_cost(node, slots - 1) <= children_cost(node, slots)) --slots;
    open(node, slots, children);
  }

 private:
  /// Places a node into at most `slots` slots, at least one.
  void place(std::uint32_t index, int slots, std::vector<std::uint32_t>& children) const {
    const BinaryNode& node = binary_.nodes[index];
    const auto& cost = costs_[index];
    while (slots > 1 && cost[slots - 1] <= cost[slots]) --slots;
    if (slots == 1 || node.leaf()) {
      children.push_back(index);
    } else {
      open(node, slots, children);
    }
  }

  void open(const BinaryNode& node, int slots, std::vector<std::uint32_t>& children) const {
    int left = 0;
    children_cost(node, slots, &left);
    place(node.left, left, children);
    place(node.right, slots - left, children);
  }

  /// Returns the minimum cost of both children in `slots` slots. Sets *left, unless null, to the
  /// number of slots for the left child.
  float children_cost(const BinaryNode& node, int slots, int* left = nullptr) const {
    const auto& a = costs_[node.left];
    const auto& b = costs_[node.right];
    float best = std::numeric_limits<float>::infinity();
    int best_left = 1;
    for (int k = 1; k < slots; ++k) {
      if (!(a[k] + b[slots - k] < best)) continue;
      best = a[k] + b[slots - k];
      best_left = k;
    }
    if (left != nullptr) *left = best_left;
    return best;
  }

  const BinaryBvh& binary_;
  std::vector<std::array<float, kWidth>> costs_;  // by number of slots, 1 to kWidth - 1
};

}  // namespace

template <int kWidth>
WideBvh<kWidth> collapse(const BinaryBvh& binary) {
  struct Task {
    std::uint32_t binary, parent;  // parent: index of a wide node
    int slot;
  };
  WideBvh<kWidth> bvh;
  std::vector<WideNode<kWidth>> nodes(1);
  std::vector<Task> tasks;
  std::vector<std::uint32_t> children;
  const Costs<kWidth> costs(binary);
  const auto add_children = [&](std::uint32_t parent) {
    for (std::size_t i = children.size(); i-- > 0;) {  // the first is popped first
      const auto slot = static_cast<int>(i);
      nodes[parent].set_child(slot, binary.nodes[children[i]].box, kLeafBit);
      tasks.push_back({children[i], parent, slot});
    }
  };
  if (!binary.nodes.empty()) {
    bvh.bounds = binary.nodes[0].box;
    children = {0};
    if (!binary.nodes[0].leaf()) costs.children_of(0, children);
    add_children(0);
  }
  while (!tasks.empty()) {
    const Task task = tasks.back();
    tasks.pop_back();
    const BinaryNode& source = binary.nodes[task.binary];
    std::uint32_t& reference = nodes[task.parent].children[task.slot];
    if (source.leaf()) {
      reference = kLeafBit | static_cast<std::uint32_t>(bvh.leaves.size());
      bvh.leaves.push_back({static_cast<std::uint32_t>(bvh.order.size()), source.count});
      const auto items = binary.order.begin() + source.first;
      bvh.order.insert(bvh.order.end(), items, items + source.count);
      continue;
    }
    const auto index = static_cast<std::uint32_t>(nodes.size());
    reference = node_reference<kWidth>(index);
    nodes.emplace_back();
    costs.children_of(task.binary, children);
    add_children(index);
  }
  bvh.nodes = HugeArray<WideNode<kWidth>>(nodes.size());
  std::copy(nodes.begin(), nodes.end(), bvh.nodes.data());
  return bvh;
}

template WideBvh<8> collapse<8>(const BinaryBvh& binary);
template WideBvh<16> collapse<16>(const BinaryBvh& binary);

}  // namespace tessera::render
