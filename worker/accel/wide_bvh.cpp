#include "worker/accel/wide_bvh.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tessera::render {
namespace {

constexpr int kBins = 16;
/// From this depth on nodes are split by count: at most 31 more levels, and kWidth - 1 entries a
/// level stay below kStackSize.
constexpr int kMaxSahDepth = 40;
/// Ranges larger than this are split one after the other, smaller ones in parallel.
constexpr std::uint32_t kParallelRange = 1u << 13;

struct Item {
  Box3f box;
  std::uint32_t id;

  Vec3f centroid() const { return (box.lo + box.hi) * 0.5f; }
};

struct BinaryNode {
  Box3f box;
  std::uint32_t first = 0, count = 0;
  std::uint32_t left = 0, right = 0;  // both 0: a leaf
  int depth = 0;

  bool leaf() const { return left == 0; }
};

struct Bin {
  Box3f box;
  std::uint32_t count = 0;
};

struct Split {
  int axis = -1;
  int bin = 0;  // items in bins < bin go left
  double cost = 0;
};

/// Maps centroids along one axis to bins; `usable` is false where they (nearly) coincide.
struct BinScale {
  float low = 0, scale = 0;
  bool usable = false;

  BinScale(float lo, float hi) : low(lo), scale(static_cast<float>(kBins) / (hi - lo)) {
    usable = hi > lo && scale < std::numeric_limits<float>::max();
  }
  int bin(float centroid) const {
    const float x = (centroid - low) * scale;
    return static_cast<int>(clamp(x, 0.0f, static_cast<float>(kBins - 1)));
  }
};

class Builder {
 public:
  Builder(std::span<Item> items, std::uint32_t leaf_size) : items_(items), leaf_size_(leaf_size) {}

  /// Splits `node` if it pays; appends the children to `nodes`, which may move `node`.
  bool split(std::vector<BinaryNode>& nodes, std::uint32_t index) const {
    const BinaryNode node = nodes[index];
    if (node.count <= 1) return false;
    const std::uint32_t middle = divide(node);
    if (middle == node.first) return false;
    nodes[index].left = static_cast<std::uint32_t>(nodes.size());
    nodes[index].right = nodes[index].left + 1;
    nodes.push_back(make_node(node.first, middle - node.first, node.depth + 1));
    nodes.push_back(make_node(middle, node.first + node.count - middle, node.depth + 1));
    return true;
  }

  /// The whole tree under `root`, which becomes element 0; indices are relative to the vector.
  std::vector<BinaryNode> build(const BinaryNode& root) const {
    std::vector<BinaryNode> nodes = {root};
    for (std::uint32_t i = 0; i < nodes.size(); ++i) split(nodes, i);
    return nodes;
  }

  BinaryNode make_node(std::uint32_t first, std::uint32_t count, int depth) const {
    BinaryNode node;
    node.first = first;
    node.count = count;
    node.depth = depth;
    for (const Item& item : items_.subspan(first, count)) node.box.extend(item.box);
    return node;
  }

 private:
  /// Reorders the node's items and returns where the right child starts; `first` for a leaf.
  std::uint32_t divide(const BinaryNode& node) const {
    const std::span<Item> range = items_.subspan(node.first, node.count);
    Box3f centroids;
    for (const Item& item : range) centroids.extend(item.centroid());
    const std::array<BinScale, 3> scales = {BinScale{centroids.lo.x, centroids.hi.x},
                                            BinScale{centroids.lo.y, centroids.hi.y},
                                            BinScale{centroids.lo.z, centroids.hi.z}};
    const Split best = node.depth < kMaxSahDepth ? best_split(range, scales) : Split{};
    if (node.count <= leaf_size_ && !(best.axis >= 0 && best.cost < node.box.half_area())) {
      return node.first;
    }
    if (best.axis < 0) return node.first + split_by_count(range, centroids);
    const BinScale& scale = scales[best.axis];
    const auto middle = std::partition(range.begin(), range.end(), [&](const Item& item) {
      return scale.bin(item.centroid()[best.axis]) < best.bin;
    });
    return node.first + static_cast<std::uint32_t>(middle - range.begin());
  }

  /// Cost is the sum over children of half area times leaf tests.
  Split best_split(std::span<const Item> range, const std::array<BinScale, 3>& scales) const {
    std::array<std::array<Bin, kBins>, 3> bins{};
    for (const Item& item : range) {
      const Vec3f c = item.centroid();
      for (int axis = 0; axis < 3; ++axis) {
        if (!scales[axis].usable) continue;
        Bin& bin = bins[axis][scales[axis].bin(c[axis])];
        bin.box.extend(item.box);
        ++bin.count;
      }
    }
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
      if (scales[axis].usable) sweep(bins[axis], axis, best);
    }
    return best;
  }

  void sweep(const std::array<Bin, kBins>& bins, int axis, Split& best) const {
    std::array<double, kBins> right_cost{};
    Bin sum;
    for (int i = kBins - 1; i > 0; --i) {
      sum.box.extend(bins[i].box);
      sum.count += bins[i].count;
      right_cost[i] = sum.box.half_area() * leaf_tests(sum.count);
    }
    Bin left;
    for (int i = 1; i < kBins; ++i) {
      left.box.extend(bins[i - 1].box);
      left.count += bins[i - 1].count;
      const std::uint32_t right_count = total(bins) - left.count;
      if (left.count == 0 || right_count == 0) continue;
      const double cost = left.box.half_area() * leaf_tests(left.count) + right_cost[i];
      if (best.axis < 0 || cost < best.cost) best = {axis, i, cost};
    }
  }

  static std::uint32_t total(const std::array<Bin, kBins>& bins) {
    std::uint32_t sum = 0;
    for (const Bin& bin : bins) sum += bin.count;
    return sum;
  }

  double leaf_tests(std::uint32_t count) const {
    const std::uint32_t tests = (count + leaf_size_ - 1) / leaf_size_;
    return static_cast<double>(tests);
  }

  /// Half of the items, by centroid along the longest axis, then by id: always ends.
  static std::uint32_t split_by_count(std::span<Item> range, const Box3f& centroids) {
    const Vec3f size = centroids.hi - centroids.lo;
    const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
    const auto middle = range.begin() + static_cast<std::ptrdiff_t>(range.size() / 2);
    std::nth_element(range.begin(), middle, range.end(), [axis](const Item& a, const Item& b) {
      const float ca = a.centroid()[axis], cb = b.centroid()[axis];
      return ca < cb || (ca == cb && a.id < b.id);
    });
    return static_cast<std::uint32_t>(range.size() / 2);
  }

  std::span<Item> items_;
  std::uint32_t leaf_size_;
};

/// The binary tree: large ranges are split in turn, then the subtrees below them in parallel and
/// appended in order, so the result does not depend on threads.
std::vector<BinaryNode> build_binary(std::span<Item> items, std::uint32_t leaf_size,
                                     const ParallelFor& parallel_for) {
  const Builder builder(items, leaf_size);
  std::vector<BinaryNode> nodes = {
      builder.make_node(0, static_cast<std::uint32_t>(items.size()), 0)};
  std::vector<std::uint32_t> roots;
  for (std::uint32_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].count <= kParallelRange) {
      roots.push_back(i);
    } else {
      builder.split(nodes, i);
    }
  }
  std::vector<std::vector<BinaryNode>> subtrees(roots.size());
  parallel_for(static_cast<std::int64_t>(roots.size()), [&](std::int64_t i) {
    subtrees[static_cast<std::size_t>(i)] =
        builder.build(nodes[roots[static_cast<std::size_t>(i)]]);
  });
  for (std::size_t r = 0; r < roots.size(); ++r) {
    // Element 0 of a subtree replaces its root, the others follow the nodes so far.
    const auto offset = static_cast<std::uint32_t>(nodes.size()) - 1;
    for (BinaryNode& node : subtrees[r]) {
      if (node.leaf()) continue;
      node.left += offset;
      node.right += offset;
    }
    nodes[roots[r]] = subtrees[r][0];
    nodes.insert(nodes.end(), subtrees[r].begin() + 1, subtrees[r].end());
    std::vector<BinaryNode>().swap(subtrees[r]);
  }
  return nodes;
}

/// The up to eight descendants of `node` that become its children: opens the largest first.
std::vector<std::uint32_t> open_children(const std::vector<BinaryNode>& nodes,
                                         const BinaryNode& node) {
  std::vector<std::uint32_t> children = {node.left, node.right};
  while (children.size() < kWidth) {
    int largest = -1;
    double area = -1;
    for (std::size_t i = 0; i < children.size(); ++i) {
      const BinaryNode& child = nodes[children[i]];
      if (child.leaf() || child.box.half_area() <= area) continue;
      area = child.box.half_area();
      largest = static_cast<int>(i);
    }
    if (largest < 0) break;
    const BinaryNode& opened = nodes[children[static_cast<std::size_t>(largest)]];
    children[static_cast<std::size_t>(largest)] = opened.left;
    children.push_back(opened.right);
  }
  return children;
}

void set_child(WideNode& node, std::size_t slot, const Box3f& box, std::uint32_t child) {
  for (int axis = 0; axis < 3; ++axis) {
    node.planes[static_cast<std::size_t>(axis)][0][slot] = box.lo[axis];
    node.planes[static_cast<std::size_t>(axis)][1][slot] = box.hi[axis];
  }
  node.children[slot] = child;
}

WideNode empty_node() {
  WideNode node{};
  for (std::size_t slot = 0; slot < kWidth; ++slot) set_child(node, slot, Box3f{}, kLeafBit);
  return node;
}

void collapse(const std::vector<BinaryNode>& binary, WideBvh& bvh) {
  struct Task {
    std::uint32_t binary, wide;
  };
  bvh.nodes.push_back(empty_node());
  std::vector<Task> tasks = {{0, 0}};
  while (!tasks.empty()) {
    const Task task = tasks.back();
    tasks.pop_back();
    const BinaryNode& source = binary[task.binary];
    const std::vector<std::uint32_t> children =
        source.leaf() ? std::vector<std::uint32_t>{task.binary} : open_children(binary, source);
    for (std::size_t slot = 0; slot < children.size(); ++slot) {
      const BinaryNode& child = binary[children[slot]];
      std::uint32_t reference = 0;
      if (child.leaf()) {
        reference = kLeafBit | static_cast<std::uint32_t>(bvh.leaves.size());
        bvh.leaves.push_back({child.first, child.count});
      } else {
        reference = static_cast<std::uint32_t>(bvh.nodes.size());
        bvh.nodes.push_back(empty_node());
        tasks.push_back({children[slot], reference});
      }
      set_child(bvh.nodes[task.wide], slot, child.box, reference);
    }
  }
}

}  // namespace

WideBvh build_wide_bvh(std::span<const Box3f> boxes, std::uint32_t leaf_size,
                       const ParallelFor& parallel_for) {
  WideBvh bvh;
  if (boxes.empty()) {
    bvh.nodes.push_back(empty_node());
    return bvh;
  }
  std::vector<Item> items(boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    items[i] = {boxes[i], static_cast<std::uint32_t>(i)};
  }
  const std::vector<BinaryNode> binary = build_binary(items, leaf_size, parallel_for);
  bvh.bounds = binary[0].box;
  bvh.order.reserve(items.size());
  for (const Item& item : items) bvh.order.push_back(item.id);
  collapse(binary, bvh);
  return bvh;
}

}  // namespace tessera::render
