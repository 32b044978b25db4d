// BSP trees of axis-parallel planes: the axis-aligned BSP tree, in which the axis of each plane is
// chosen by cost, and the kd-tree, in which x, y and z take turns; only the position is chosen by
// cost, and an axis on which no plane pays is passed over. Planes are chosen by the binned surface
// area heuristic.
//
// A shape is in every leaf that its box overlaps; the ray is split at the plane, and its nearer
// part is traversed first. Boxes are exact, but hits may lie slightly outside them, so both parts
// extend beyond the plane by ShapeRay::hit_tolerance. The shape of a hit is then found in the leaf
// that contains the point of its box nearest to the hit.
//
// Sources: J. Bentley, "Multidimensional binary search trees used for associative searching", 1975
// (axes in turn); M. Kaplan, "Space-tracing: a constant time ray tracer", 1985; F. Jansen, "Data
// structures for ray tracing", 1986 (the recursion).

#include <algorithm>
#include <bit>
#include <cstdint>
#include <vector>

#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::uint32_t kLeafSize = 3;
constexpr int kBins = 32;
constexpr double kVisitCost = 1;  // cost of visiting a node relative to testing a shape

struct Node {
  float plane = 0;
  std::int32_t axis = -1;              // -1: a leaf
  std::uint32_t below = 0, above = 0;  // children; in a leaf: first and count in `items`
};

struct Cut {
  int axis = -1;
  float plane = 0;
  double cost = 0;
};

enum class Axes { by_cost, in_turn };

class Builder {
 public:
  Builder(const ShapeBounds& shapes, Axes axes) : shapes_(shapes), axes_(axes) {}

  /// `turn` is the axis that comes first if they take turns.
  std::uint32_t build(std::vector<std::uint32_t> shapes, const Box3f& cell, int depth, int turn) {
    const auto index = static_cast<std::uint32_t>(nodes.size());
    nodes.emplace_back();
    const Cut cut = depth > 0 && shapes.size() > kLeafSize ? choose(shapes, cell, turn) : Cut{};
    if (cut.axis < 0) {
      nodes[index].below = static_cast<std::uint32_t>(items.size());
      nodes[index].above = static_cast<std::uint32_t>(shapes.size());
      items.insert(items.end(), shapes.begin(), shapes.end());
      return index;
    }
    std::vector<std::uint32_t> below, above;
    for (const std::uint32_t shape : shapes) {
      const Box3f& box = shapes_.boxes[shape];
      if (box.lo[cut.axis] <= cut.plane) below.push_back(shape);
      if (box.hi[cut.axis] > cut.plane) above.push_back(shape);
    }
    std::vector<std::uint32_t>().swap(shapes);
    Box3f low = cell, high = cell;
    low.hi[cut.axis] = high.lo[cut.axis] = cut.plane;
    nodes[index].plane = cut.plane;
    nodes[index].axis = cut.axis;
    const int next = (cut.axis + 1) % 3;
    const std::uint32_t first = build(std::move(below), low, depth - 1, next);
    const std::uint32_t second = build(std::move(above), high, depth - 1, next);
    nodes[index].below = first;
    nodes[index].above = second;
    return index;
  }

  std::vector<Node> nodes;
  std::vector<std::uint32_t> items;

 private:
  /// Returns the plane to cut with; its axis is -1 if none is cheaper than a leaf.
  Cut choose(const std::vector<std::uint32_t>& shapes, const Box3f& cell, int turn) const {
    Cut best;
    best.cost = cell.half_area() * static_cast<double>(shapes.size());
    for (int i = 0; i < 3; ++i) {
      improve(shapes, cell, (turn + i) % 3, best);
      if (axes_ == Axes::in_turn && best.axis >= 0) break;
    }
    return best;
  }

  /// Replaces `best` by the best plane of an axis, by the surface area heuristic, if it is cheaper.
  void improve(const std::vector<std::uint32_t>& shapes, const Box3f& cell, int axis,
               Cut& best) const {
    const float low = cell.lo[axis], width = (cell.hi[axis] - low) / kBins;
    if (!(low + width > low)) return;
    std::uint32_t entries[kBins] = {}, exits[kBins] = {};
    const auto bin = [&](float x) {
      const float b = (x - low) / width;
      return b > 0 ? (b < kBins - 1 ? static_cast<int>(b) : kBins - 1) : 0;
    };
    for (const std::uint32_t shape : shapes) {
      ++entries[bin(shapes_.boxes[shape].lo[axis])];
      ++exits[bin(shapes_.boxes[shape].hi[axis])];
    }
    double below = 0, above = static_cast<double>(shapes.size());
    for (int i = 1; i < kBins; ++i) {
      below += entries[i - 1];
      above -= exits[i - 1];
      const float plane = low + width * static_cast<float>(i);
      Box3f left = cell, right = cell;
      left.hi[axis] = right.lo[axis] = plane;
      const double cost =
          left.half_area() * below + right.half_area() * above + cell.half_area() * kVisitCost;
      if (cost < best.cost) best = {axis, plane, cost};
    }
  }

  const ShapeBounds& shapes_;
  const Axes axes_;
};

class AxisBsp final : public ShapeIndex {
 public:
  AxisBsp(const ShapeBounds& shapes, Axes axes) {
    Builder builder(shapes, axes);
    const int depth = 8 + static_cast<int>(std::bit_width(shapes.size())) * 13 / 10;
    builder.build(all_shapes(shapes.size()), shapes.all(), depth, 0);
    nodes_ = std::move(builder.nodes);
    items_ = std::move(builder.items);
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    Mailbox mailbox;
    return descend(0, {0, static_cast<double>(limit)}, {ray, limit, visit, mailbox, stats});
  }
  std::size_t memory_bytes() const override {
    return nodes_.capacity() * sizeof(Node) + items_.capacity() * sizeof(std::uint32_t);
  }

 private:
  bool descend(std::uint32_t index, Segment part, const ShapeTraversal& traversal) const {
    part.last = std::min(part.last, static_cast<double>(traversal.limit));
    if (part.empty()) return false;
    const Node& node = nodes_[index];
    ++traversal.stats.nodes;
    if (node.axis < 0) {
      return visit_all(std::span(items_).subspan(node.below, node.above), traversal.visit,
                       traversal.mailbox);
    }
    const double plane = node.plane, tolerance = traversal.ray.hit_tolerance;
    const Segment below = clip(traversal.ray, part, node.axis, plane + tolerance, false);
    const Segment above = clip(traversal.ray, part, node.axis, plane - tolerance, true);
    if (traversal.ray.box_direction[node.axis] >= 0) {
      return descend(node.below, below, traversal) || descend(node.above, above, traversal);
    }
    return descend(node.above, above, traversal) || descend(node.below, below, traversal);
  }

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> items_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_axis_bsp(const ShapeBounds& shapes) {
  return std::make_unique<AxisBsp>(shapes, Axes::by_cost);
}

std::unique_ptr<ShapeIndex> build_kd_tree(const ShapeBounds& shapes) {
  return std::make_unique<AxisBsp>(shapes, Axes::in_turn);
}

}  // namespace tessera::render::accelerators
