#include "worker/accel/tree_quality.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace tessera::render {
namespace {

constexpr std::size_t kMostTriangles = 20'000;

/// A triangle cut by boxes: each of the six planes adds at most one corner.
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

/// The part on the side of the plane where sign * (x[axis] - plane) <= 0.
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

/// What a triangle adds to the end-point overlap of the boxes at and below a child.
struct Overlap {
  double area = 0;     // summed over the boxes that do not hold the triangle
  bool holds = false;  // whether this child does
};

template <int kWidth>
class Metrics {
 public:
  explicit Metrics(const MeshTree<kWidth>& tree) : tree_(tree) {}

  TreeQuality measure() {
    TreeQuality out;
    const double root = tree_.bounds.half_area();
    if (tree_.blocks.empty() || !(root > 0)) return out;
    out.sah = 1 + area_below(0) / root;
    const std::size_t step = 1 + tree_.blocks.size() * kBlockSize / kMostTriangles;
    double total = 0, overlap = 0;
    std::size_t n = 0;
    for (std::size_t b = 0; b < tree_.blocks.size(); ++b) {
      for (int lane = 0; lane < kBlockSize; ++lane) {
        const Polygon triangle = corners(tree_.blocks.data()[b], lane);
        const double area = triangle.area();
        if (!(area > 0) || n++ % step != 0) continue;
        total += area;
        overlap += overlap_below(0, tree_.blocks.data()[b].rank[lane], triangle);
      }
    }
    if (total > 0) out.end_point_overlap = overlap / total;
    return out;
  }

 private:
  static Polygon corners(const TriangleBlock& block, int lane) {
    Polygon triangle;
    for (std::size_t vertex = 0; vertex < 3; ++vertex) {
      Vec3d p;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        p[static_cast<int>(axis)] = static_cast<double>(
            block.v[TriangleBlock::at(vertex, axis) + static_cast<std::size_t>(lane)]);
      }
      triangle.add(p);
    }
    return triangle;
  }

  double area_below(std::uint32_t reference) const {
    const WideNode<kWidth>& node = node_at(tree_.nodes.data(), reference);
    double sum = 0;
    for (int slot = 0; slot < kWidth; ++slot) {
      const Box3f box = node.box(slot);
      if (box.empty()) continue;
      sum += box.half_area();
      if ((node.children[slot] & kLeafBit) == 0) sum += area_below(node.children[slot]);
    }
    return sum;
  }

  double overlap_below(std::uint32_t reference, std::uint32_t rank, const Polygon& polygon) const {
    return at_node(reference, rank, polygon).area;
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
      sum.holds = sum.holds || below.holds;
      sum.area += below.area + (below.holds ? 0 : area);
    }
    return sum;
  }

  Overlap at_child(std::uint32_t child, std::uint32_t rank, const Polygon& polygon) const {
    if ((child & kLeafBit) == 0) return at_node(child, rank, polygon);
    const TriangleBlock& block = tree_.blocks.data()[child & ~kLeafBit];
    for (int lane = 0; lane < kBlockSize; ++lane) {  // unused lanes have rank 0, too
      if (block.rank[lane] == rank && corners(block, lane).area() > 0) return {0, true};
    }
    return {0, false};
  }

  const MeshTree<kWidth>& tree_;
};

}  // namespace

template <int kWidth>
TreeQuality quality_of(const MeshTree<kWidth>& tree) {
  return Metrics<kWidth>(tree).measure();
}

template TreeQuality quality_of<8>(const MeshTree<8>&);
template TreeQuality quality_of<16>(const MeshTree<16>&);

}  // namespace tessera::render
