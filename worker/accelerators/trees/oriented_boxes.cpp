// A hierarchy of boxes along the principal axes of their contents, for slanted bars and needles.
// Each node also has its axis-parallel box, because only that bounds t. Source: S. Gottschalk,
// M. Lin, D. Manocha, "OBBTree: a hierarchical structure for rapid interference detection", 1996.

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "worker/accelerators/shapes/depth_first.h"
#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

struct OrientedBox {
  std::array<Vec3d, 3> axes = {Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, 0, 1}};  // orthonormal
  Vec3d lo, hi;  // coordinates along the axes
};

using Matrix = std::array<std::array<double, 3>, 3>;

/// Applies the Jacobi rotation of rows and columns p and q that makes m[p][q] zero.
void rotate(Matrix& m, std::array<Vec3d, 3>& rows, std::size_t p, std::size_t q) {
  const double theta = (m[q][q] - m[p][p]) / (2 * m[p][q]);
  const double t = (theta < 0 ? -1.0 : 1.0) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
  const double c = 1 / std::sqrt(t * t + 1), s = t * c;
  for (std::size_t k = 0; k < 3; ++k) {
    const double a = m[k][p], b = m[k][q];
    m[k][p] = c * a - s * b;
    m[k][q] = s * a + c * b;
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const double a = m[p][k], b = m[q][k];
    m[p][k] = c * a - s * b;
    m[q][k] = s * a + c * b;
  }
  const Vec3d a = rows[p], b = rows[q];
  rows[p] = a * c - b * s;
  rows[q] = a * s + b * c;
}

/// Returns the eigenvectors of a symmetric matrix.
std::array<Vec3d, 3> eigenvectors(Matrix m) {
  std::array<Vec3d, 3> rows = {Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, 0, 1}};
  for (int sweep = 0; sweep < 12; ++sweep) {
    for (std::size_t p = 0; p < 2; ++p) {
      for (std::size_t q = p + 1; q < 3; ++q) {
        if (m[p][q] != 0) rotate(m, rows, p, q);
      }
    }
  }
  return rows;
}

/// Calls visit(point) for each corner of the hulls below a node.
template <typename Visit>
void for_each_point(const DepthFirstTree& tree, const DepthFirstNode& node,
                    const ShapeBounds& shapes, Visit&& visit) {
  for (std::uint32_t i = 0; i < node.count; ++i) {
    for (const Vec3f& p : shapes.hull(tree.order[node.first + i])) visit(Vec3d(p));
  }
}

std::array<Vec3d, 3> principal_axes(const DepthFirstTree& tree, const DepthFirstNode& node,
                                    const ShapeBounds& shapes) {
  const Vec3d middle = (Vec3d(node.box.lo) + Vec3d(node.box.hi)) * 0.5;
  const Vec3d size = Vec3d(node.box.hi) - Vec3d(node.box.lo);
  const double scale = max_abs(size) > 0 ? 1 / max_abs(size) : 1;
  Vec3d sum;
  Matrix products{};
  for_each_point(tree, node, shapes, [&](const Vec3d& p) {
    const Vec3d q = (p - middle) * scale;
    sum += q;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        products[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] += q[i] * q[j];
      }
    }
  });
  const double count = static_cast<double>(node.count * shapes.points_per_hull);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      products[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] -= sum[i] * sum[j] / count;
    }
  }
  return eigenvectors(products);
}

OrientedBox box_along(const std::array<Vec3d, 3>& axes, const DepthFirstTree& tree,
                      const DepthFirstNode& node, const ShapeBounds& shapes) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  OrientedBox box{axes, {kInf, kInf, kInf}, {-kInf, -kInf, -kInf}};
  for_each_point(tree, node, shapes, [&](const Vec3d& p) {
    const Vec3d q = {dot(axes[0], p), dot(axes[1], p), dot(axes[2], p)};
    box.lo = min(box.lo, q);
    box.hi = max(box.hi, q);
  });
  return box;
}

/// Returns a box around the hulls below a node, along their principal axes or along the coordinate
/// axes, whichever has the smaller area.
OrientedBox box_around(const DepthFirstTree& tree, const DepthFirstNode& node,
                       const ShapeBounds& shapes) {
  const OrientedBox turned = box_along(principal_axes(tree, node, shapes), tree, node, shapes);
  const OrientedBox straight = box_along(OrientedBox{}.axes, tree, node, shapes);
  const auto area = [](const OrientedBox& box) { return Box3d{box.lo, box.hi}.half_area(); };
  return area(turned) < area(straight) ? turned : straight;
}

class OrientedBoxes final : public ShapeIndex {
 public:
  OrientedBoxes(DepthFirstTree tree, const ShapeBounds& shapes) : tree_(std::move(tree)) {
    boxes_.reserve(tree_.nodes.size());
    for (const DepthFirstNode& node : tree_.nodes) {
      boxes_.push_back(box_around(tree_, node, shapes));
    }
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    const auto hits = [&](std::uint32_t node, double& enter) {
      float box_enter = 0;
      if (!may_hit(ray.slabs, tree_.nodes[node].box, limit, box_enter)) return false;
      enter = box_enter;
      return line_hits(boxes_[node], ray);
    };
    double enter = 0;
    return hits(0, enter) && traverse_near_first({tree_, limit, visit, stats}, hits);
  }
  std::size_t memory_bytes() const override {
    return tree_.memory_bytes() + boxes_.capacity() * sizeof(OrientedBox);
  }

 private:
  /// Returns whether the ray's line comes within the error of hits of the box. The error is
  /// sqrt(3) * hit_tolerance; the margin is more than twice that, to cover the rounding here.
  static bool line_hits(const OrientedBox& box, const ShapeRay& ray) {
    const double margin = 4 * ray.hit_tolerance;
    double first = -std::numeric_limits<double>::infinity(), last = -first;
    for (std::size_t k = 0; k < 3; ++k) {
      const int i = static_cast<int>(k);
      const double o = dot(box.axes[k], ray.origin), d = dot(box.axes[k], ray.direction);
      const double lo = box.lo[i] - margin - o, hi = box.hi[i] + margin - o;
      if (d == 0) {
        if (lo > 0 || hi < 0) return false;
        continue;
      }
      first = std::max(first, d > 0 ? lo / d : hi / d);
      last = std::min(last, d > 0 ? hi / d : lo / d);
    }
    return first <= last;
  }

  DepthFirstTree tree_;
  std::vector<OrientedBox> boxes_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_oriented_boxes(const ShapeBounds& shapes) {
  return std::make_unique<OrientedBoxes>(build_depth_first(shapes), shapes);
}

}  // namespace tessera::render::accelerators
