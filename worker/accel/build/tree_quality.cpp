#include "worker/accel/build/tree_quality.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace tessera::render {
namespace {

constexpr std::size_t kMaxTriangles = 20'000;

/// A triangle clipped to boxes. Each of a box's six planes adds at most one corner.
struct Polygon {
  std::array<Vec3d, 9> corners;
  std::size_t count = 0;

  void add(const Vec3d& p) { corners[count++] = p; }
  double area() const {
    Vec3d sum{};
    for (std::size_t i = 2; i < count; ++i) {
      sum += cross(corners[i - 1] - corners[0], corners[i] - corners[0]);
    }
    return 0.5 * length(sum);
  }
};

/// Returns the part of the polygon where sign * (x[axis] - plane) <= 0.
Polygon cut(const Polygon& polygon, int axis, double plane, double sign) {
  Polygon out;
  for (std::size_t i = 0; i < polygon.count; ++i) {
    const Vec3d &a = polygon.corners[i], &b = polygon.corners[(i + 1) % polygon.count];
    const double from = sign * (a[axis] - plane), to = sign * (b[axis] - plane);
    if (from <= 0) out.add(a);
    if ((from < 0 && to > 0) || (from > 0 && to < 0)) out.add(a + (b - a) * (from / (from - to)));
  }
  return out;
}

Polygon cut(Polygon polygon, const Box3f& box) {
  for (int axis = 0; axis < 3 && polygon.count > 0; ++axis) {
    polygon = cut(cut(polygon, axis, static_cast<double>(box.hi[axis]), 1), axis,
                  static_cast<double>(box.lo[axis]), -1);
  }
  return polygon;
}

/// Contribution of a triangle to the end-point overlap of the boxes at and below a child.
struct Overlap {
  double area = 0;                 // summed over the subtrees that do not contain the triangle
  bool contains_triangle = false;  // in this child or below it
};

template <int kWidth>
class Metrics {
 public:
  explicit Metrics(const MeshBvh<kWidth>& tree) : tree_(tree) {}

  TreeQuality measure() {
    TreeQuality out;
    out.sah = sah_cost(tree_);
    if (!(out.sah > 0)) return out;
    const std::size_t step = 1 + tree_.blocks.size() * kBlockSize / kMaxTriangles;
    double total = 0, overlap = 0;
    std::size_t n = 0;
    for (std::size_t b = 0; b < tree_.blocks.size(); ++b) {
      const TriangleBlock& block = tree_.blocks[b];
      for (std::size_t lane = 0; lane < kBlockSize; ++lane) {
        if (!block.has_triangle(lane) || n++ % step != 0) continue;
        const Polygon triangle = corners(block, lane);
        total += triangle.area();
        overlap += at_node(0, block.rank[lane], triangle).area;
      }
    }
    if (total > 0) out.end_point_overlap = overlap / total;
    return out;
  }

 private:
  static Polygon corners(const TriangleBlock& block, std::size_t lane) {
    Polygon triangle;
    for (std::size_t vertex = 0; vertex < 3; ++vertex) {
      triangle.add(Vec3d(block.corner(lane, vertex)));
    }
    return triangle;
  }

  Overlap at_node(std::uint32_t reference, std::uint32_t rank, const Polygon& polygon) const {
    const WideNode<kWidth>& node = node_at(tree_.nodes.data(), reference);
    Overlap sum;
    for (int slot = 0; slot < kWidth; ++slot) {
      const Box3f box = node.box(slot);
      if (box.empty()) continue;
      const Polygon inside = cut(polygon, box);
      const double area = inside.area();
      if (!(area > 0)) continue;
      const Overlap below = at_child(node.children[slot], rank, inside);
      sum.contains_triangle = sum.contains_triangle || below.contains_triangle;
      sum.area += below.area + (below.contains_triangle ? 0 : area);
    }
    return sum;
  }

  Overlap at_child(std::uint32_t child, std::uint32_t rank, const Polygon& polygon) const {
    if ((child & kLeafBit) == 0) return at_node(child, rank, polygon);
    const TriangleBlock& block = tree_.blocks[child & ~kLeafBit];
    for (std::size_t lane = 0; lane < kBlockSize; ++lane) {
      if (block.rank[lane] == rank && block.has_triangle(lane)) return {0, true};
    }
    return {0, false};
  }

  const MeshBvh<kWidth>& tree_;
};

}  // namespace

template <int kWidth>
double sah_cost(const MeshBvh<kWidth>& tree) {
  const double root = tree.bounds.half_area();
  if (tree.blocks.empty() || !(root > 0)) return 0;
  double sum = root;
  for (std::size_t i = 0; i < tree.nodes.size(); ++i) {
    for (int slot = 0; slot < kWidth; ++slot) sum += tree.nodes[i].box(slot).half_area();
  }
  return sum / root;
}

template <int kWidth>
TreeQuality measure_tree_quality(const MeshBvh<kWidth>& tree) {
  return Metrics<kWidth>(tree).measure();
}

template double sah_cost<8>(const MeshBvh<8>&);
template double sah_cost<16>(const MeshBvh<16>&);
template TreeQuality measure_tree_quality<8>(const MeshBvh<8>&);
template TreeQuality measure_tree_quality<16>(const MeshBvh<16>&);

}  // namespace tessera::render
