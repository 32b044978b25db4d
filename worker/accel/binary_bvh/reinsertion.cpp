#include "worker/accel/binary_bvh/reinsertion.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include "worker/accel/layout/wide_node.h"

namespace tessera::render {
namespace {

constexpr std::uint32_t kNone = UINT32_MAX;

/// A pass ends when its searches have visited this many nodes per node of the tree. Trees of models
/// and terrain need 7 to 18, those of random triangles up to 93, so the limit does not change them;
/// where all boxes overlap, as those of concentric triangles, each search would visit the whole
/// tree.
constexpr std::uint64_t kVisitsPerNode = 256;

Box3f union_of(Box3f a, const Box3f& b) {
  a.extend(b);
  return a;
}

class Reinserter {
 public:
  explicit Reinserter(std::vector<BinaryNode>& nodes)
      : nodes_(nodes), parents_(nodes.size(), kNone) {
    for (std::uint32_t i = 0; i < nodes.size(); ++i) {
      if (nodes[i].leaf()) continue;
      parents_[nodes[i].left] = parents_[nodes[i].right] = i;
    }
  }

  void pass() {
    std::vector<double> areas(nodes_.size());
    for (std::size_t i = 0; i < nodes_.size(); ++i) areas[i] = nodes_[i].box.half_area();
    std::vector<std::uint32_t> order(nodes_.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return areas[a] > areas[b]; });
    visits_left_ = kVisitsPerNode * nodes_.size();
    for (const std::uint32_t node : order) {
      if (visits_left_ == 0) return;
      // The parent moves with the subtree, so it cannot be the root.
      if (node == 0 || parents_[node] == 0) continue;
      const std::uint32_t target = best_position(node);
      if (target != kNone) move(node, target);
    }
  }

 private:
  std::uint32_t sibling(std::uint32_t node) const {
    const BinaryNode& parent = nodes_[parents_[node]];
    return parent.left == node ? parent.right : parent.left;
  }

  /// Returns the node that becomes the subtree's sibling in its best position, or kNone to leave
  /// the subtree in place.
  std::uint32_t best_position(std::uint32_t node) {
    const Box3f box = nodes_[node].box;
    const std::uint32_t parent = parents_[node];
    double saved = nodes_[parent].box.half_area();  // area saved by removing the subtree so far
    double best = saved * 1e-6;                     // smaller gains are rounding errors
    std::uint32_t position = kNone;
    Box3f without = nodes_[sibling(node)].box;  // box below `pivot` without the subtree
    std::uint32_t pivot = parent;
    bool first = true;
    std::uint32_t start = sibling(node);
    for (;;) {
      search(start, box, saved, first, best, position);
      if (pivot == 0) return position;
      if (!first) without.extend(nodes_[start].box);
      first = false;
      const std::uint32_t above = parents_[pivot];
      if (pivot != parent) saved += nodes_[pivot].box.half_area() - without.half_area();
      start = sibling(pivot);
      pivot = above;
    }
  }

  /// Examines positions at and below `start`. Skips the subtree's own sibling, which is no change.
  void search(std::uint32_t start, const Box3f& box, double saved, bool is_sibling, double& best,
              std::uint32_t& position) {
    const double own = box.half_area();
    stack_.clear();
    stack_.push_back({start, saved});
    while (!stack_.empty() && visits_left_ > 0) {
      --visits_left_;
      const auto [node, so_far] = stack_.back();
      stack_.pop_back();
      if (so_far - own <= best) continue;  // a parent of the subtree is at least as large
      const BinaryNode& at = nodes_[node];
      const double both = union_of(at.box, box).half_area();
      if (so_far - both > best && !(is_sibling && node == start)) {
        best = so_far - both;
        position = node;
      }
      const double below = so_far - (both - at.box.half_area());
      if (at.leaf() || below - own <= best) continue;
      stack_.push_back({at.left, below});
      stack_.push_back({at.right, below});
    }
  }

  /// Removes the subtree together with its parent; inserts that parent above `target`, with the
  /// subtree and `target` as its children.
  void move(std::uint32_t node, std::uint32_t target) {
    const std::uint32_t parent = parents_[node], other = sibling(node);
    replace_child(parents_[parent], parent, other);
    refit(parents_[other]);
    const std::uint32_t above = parents_[target];
    replace_child(above, target, parent);
    nodes_[parent].left = node;
    nodes_[parent].right = target;
    parents_[node] = parents_[target] = parent;
    refit(parent);
  }

  void replace_child(std::uint32_t parent, std::uint32_t from, std::uint32_t to) {
    BinaryNode& node = nodes_[parent];
    (node.left == from ? node.left : node.right) = to;
    parents_[to] = parent;
  }

  void refit(std::uint32_t node) {
    for (; node != kNone; node = parents_[node]) {
      BinaryNode& n = nodes_[node];
      n.box = union_of(nodes_[n.left].box, nodes_[n.right].box);
    }
  }

  struct StackEntry {
    std::uint32_t node;
    double saved;
  };
  std::vector<BinaryNode>& nodes_;
  std::vector<std::uint32_t> parents_;
  std::vector<StackEntry> stack_;
  std::uint64_t visits_left_ = 0;  // of this pass
};

/// Returns the nodes in depth-first order, left children first. Empty if there are more than
/// kMaxLevels levels.
std::vector<BinaryNode> in_depth_first_order(const std::vector<BinaryNode>& nodes) {
  struct StackEntry {
    std::uint32_t from, parent;
    bool right;
    int level;
  };
  std::vector<BinaryNode> out;
  out.reserve(nodes.size());
  std::vector<StackEntry> stack = {{0, kNone, false, 1}};
  while (!stack.empty()) {
    const StackEntry entry = stack.back();
    stack.pop_back();
    if (entry.level > kMaxLevels) return {};
    const auto index = static_cast<std::uint32_t>(out.size());
    const BinaryNode& node = out.emplace_back(nodes[entry.from]);
    if (entry.parent != kNone) {
      (entry.right ? out[entry.parent].right : out[entry.parent].left) = index;
    }
    if (node.leaf()) continue;
    stack.push_back({node.right, index, true, entry.level + 1});
    stack.push_back({node.left, index, false, entry.level + 1});
  }
  return out;
}

}  // namespace

void reinsert_subtrees(BinaryBvh& bvh, int passes) {
  if (bvh.nodes.size() < 5) return;  // no subtree can move
  std::vector<BinaryNode> nodes = bvh.nodes;
  Reinserter reinserter(nodes);
  for (int i = 0; i < passes; ++i) reinserter.pass();
  nodes = in_depth_first_order(nodes);
  if (!nodes.empty()) bvh.nodes = std::move(nodes);
}

}  // namespace tessera::render
