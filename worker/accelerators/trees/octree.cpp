// An octree: cells with many shapes are divided into eight cells of half the size. A shape is in
// every leaf that its box overlaps. Children are visited in the order given by the ray's direction
// and extend beyond their planes by ShapeRay::hit_tolerance, as in kd_tree.cpp. Source: A.
// Glassner, "Space subdivision for fast ray tracing", 1984.

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::size_t kLeafSize = 8;
constexpr int kMaxDepth = 16;
/// Maximum growth of the number of references when a cell is divided.
constexpr std::size_t kMaxGrowth = 3;

struct Node {
  Vec3d middle;
  std::uint32_t children = 0;          // index of the first of eight; 0: a leaf
  std::uint32_t first = 0, count = 0;  // range of `items`; leaves only
};

struct Cube {
  Vec3d lo;
  double size = 0;
};

class Octree final : public ShapeIndex {
 public:
  explicit Octree(const ShapeBounds& shapes) {
    const Box3f box = shapes.all();
    const Vec3d lo(box.lo), size = Vec3d(box.hi) - lo;
    nodes_.emplace_back();
    build(0, shapes, all_shapes(shapes.size()), {lo, max_component(size)}, kMaxDepth);
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    Mailbox mailbox;
    std::uint32_t backwards = 0;
    for (int k = 0; k < 3; ++k) backwards |= ray.box_direction[k] < 0 ? 1u << k : 0u;
    return descend(nodes_[0], {0, static_cast<double>(limit)},
                   {ray, backwards, limit, visit, mailbox, stats});
  }
  std::size_t memory_bytes() const override {
    return nodes_.capacity() * sizeof(Node) + items_.capacity() * sizeof(std::uint32_t);
  }

 private:
  struct Traversal {
    const ShapeRay& ray;
    std::uint32_t backwards;  // bit k: the direction is negative along axis k
    const float& limit;
    const ShapeVisitor& visit;
    Mailbox& mailbox;
    TraversalStats& stats;
  };

  void build(std::uint32_t index, const ShapeBounds& shapes, std::vector<std::uint32_t> items,
             const Cube& cube, int depth) {
    const double half = cube.size / 2;
    const Vec3d middle = cube.lo + Vec3d{half, half, half};
    std::array<std::vector<std::uint32_t>, 8> parts;
    std::size_t total = 0;
    if (items.size() > kLeafSize && depth > 0 && half > 0) {
      for (const std::uint32_t shape : items) distribute(shapes.boxes[shape], middle, shape, parts);
      for (const auto& part : parts) total += part.size();
    }
    nodes_[index].middle = middle;
    if (total == 0 || total > kMaxGrowth * items.size()) {
      nodes_[index].first = static_cast<std::uint32_t>(items_.size());
      nodes_[index].count = static_cast<std::uint32_t>(items.size());
      items_.insert(items_.end(), items.begin(), items.end());
      return;
    }
    std::vector<std::uint32_t>().swap(items);
    const auto children = static_cast<std::uint32_t>(nodes_.size());
    nodes_[index].children = children;
    nodes_.resize(nodes_.size() + 8);
    for (std::uint32_t i = 0; i < 8; ++i) {
      Cube child{cube.lo, half};
      for (int k = 0; k < 3; ++k) child.lo[k] += (i >> k & 1) != 0 ? half : 0;
      build(children + i, shapes, std::move(parts[i]), child, depth - 1);
    }
  }

  /// Adds a shape to each octant that its box overlaps.
  static void distribute(const Box3f& box, const Vec3d& middle, std::uint32_t shape,
                         std::array<std::vector<std::uint32_t>, 8>& parts) {
    for (std::uint32_t i = 0; i < 8; ++i) {
      bool inside = true;
      for (int k = 0; k < 3; ++k) {
        const bool above = (i >> k & 1) != 0;
        inside = inside && (above ? static_cast<double>(box.hi[k]) > middle[k]
                                  : static_cast<double>(box.lo[k]) <= middle[k]);
      }
      if (inside) parts[i].push_back(shape);
    }
  }

  bool descend(const Node& node, Segment part, const Traversal& traversal) const {
    ++traversal.stats.nodes;
    if (node.children == 0) {
      return visit_all(std::span(items_).subspan(node.first, node.count), traversal.visit,
                       traversal.mailbox);
    }
    for (std::uint32_t i = 0; i < 8; ++i) {
      const std::uint32_t octant = i ^ traversal.backwards;
      const Node& child = nodes_[node.children + octant];
      if (child.children == 0 && child.count == 0) continue;
      Segment inside = part;
      inside.last = std::min(inside.last, static_cast<double>(traversal.limit));
      for (int k = 0; k < 3; ++k) {
        const bool above = (octant >> k & 1) != 0;
        const double plane =
            node.middle[k] + (above ? -traversal.ray.hit_tolerance : traversal.ray.hit_tolerance);
        inside = clip(traversal.ray, inside, k, plane, above);
      }
      if (!inside.empty() && descend(child, inside, traversal)) return true;
    }
    return false;
  }

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> items_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_octree(const ShapeBounds& shapes) {
  return std::make_unique<Octree>(shapes);
}

}  // namespace tessera::render::accelerators
