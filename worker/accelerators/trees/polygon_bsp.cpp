// A BSP tree whose planes contain polygons or are perpendicular to a polygon through one of its
// edges (the planes of a convex body's own faces would not divide it). A polygon in the plane is
// stored at the node; one on both sides belongs to both. The splitting tree cuts it there and
// passes on the pieces, as published; the other one passes on the whole polygon, which is cheaper
// to build but reaches cells in which none of it lies. Hits keep their bits because a piece only
// decides where the whole polygon is tested. Triangles that move and boxes of instances are never
// split.
//
// The t of a hit may differ by ShapeRay::hull_slack from that of the polygon, so the parts of the
// ray extend beyond the plane by ShapeRay::hit_tolerance across it and by the slack along the ray.
// The boxes of the nodes bound t. Source: H. Fuchs, Z. Kedem, B. Naylor, "On visible surface
// generation by a priori tree structures", 1980.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {
namespace {

constexpr std::size_t kLeafSize = 6;
constexpr std::size_t kCandidates = 10, kMaxSampled = 512;
/// Planes whose plane_cost() is not below this are not used.
constexpr double kMaxPlaneCost = 0.9;

struct Plane {
  Vec3d normal, point;
  double side(const Vec3d& p) const { return dot(normal, p - point); }
};

/// A shape or a piece of one: the corners of a polygon, or points with a convex hull.
struct Piece {
  std::uint32_t shape = 0;
  std::vector<Vec3d> points;
};

/// Returns the part of a polygon in front of the plane, or behind it. Its new corners are in the
/// plane up to rounding. Source: I. Sutherland, G. Hodgman, "Reentrant polygon clipping", 1974.
Piece cut(const Piece& polygon, const Plane& plane, bool front) {
  Piece part{polygon.shape, {}};
  Vec3d from = polygon.points.back();
  double before = plane.side(from);
  for (const Vec3d& to : polygon.points) {
    const double after = plane.side(to);
    if ((before < 0 && after > 0) || (before > 0 && after < 0)) {
      part.points.push_back(from + (to - from) * (before / (before - after)));
    }
    if (front ? after >= 0 : after <= 0) part.points.push_back(to);
    from = to;
    before = after;
  }
  return part;
}

struct Node {
  Box3f box;  // around all shapes below, whole ones
  Plane plane;
  std::uint32_t front = 0, back = 0;   // 0: no child; both 0: a leaf
  std::uint32_t first = 0, count = 0;  // range of `items`: shapes of a leaf or in the plane
};

class Builder {
 public:
  Builder(const ShapeBounds& shapes, bool split)
      : shapes_(shapes), split_(split && shapes.points_per_hull == 3) {
    const Box3f all = shapes.all();
    plane_tolerance_ = 0x1p-40 * max_abs(Vec3d(all.hi) - Vec3d(all.lo));
  }

  void build() {
    std::vector<Piece> pieces(shapes_.size());
    for (std::uint32_t shape = 0; shape < shapes_.size(); ++shape) {
      pieces[shape].shape = shape;
      for (const Vec3f& p : shapes_.hull(shape)) pieces[shape].points.emplace_back(p);
    }
    const int depth = 2 * static_cast<int>(std::bit_width(shapes_.size())) + 4;
    build(std::move(pieces), depth);
  }

  std::vector<Node> nodes;
  std::vector<std::uint32_t> items;

 private:
  struct Sides {
    bool front = false, back = false;
  };

  std::uint32_t build(std::vector<Piece> pieces, int depth) {
    const auto index = static_cast<std::uint32_t>(nodes.size());
    Node node;
    for (const Piece& piece : pieces) node.box.extend(shapes_.boxes[piece.shape]);
    nodes.push_back(node);
    Plane plane;
    if (depth == 0 || pieces.size() <= kLeafSize || !choose(pieces, plane)) {
      store(index, pieces);
      return index;
    }
    std::vector<Piece> front, back, coplanar;
    for (Piece& piece : pieces) {
      const Sides sides = sides_of(piece, plane);
      if (sides.front && sides.back) {
        front.push_back(split_ ? cut(piece, plane, true) : piece);
        back.push_back(split_ ? cut(piece, plane, false) : std::move(piece));
      } else {
        (sides.front ? front : sides.back ? back : coplanar).push_back(std::move(piece));
      }
    }
    std::vector<Piece>().swap(pieces);
    store(index, coplanar);
    nodes[index].plane = plane;
    if (!front.empty()) {
      const std::uint32_t child = build(std::move(front), depth - 1);
      nodes[index].front = child;
    }
    if (!back.empty()) {
      const std::uint32_t child = build(std::move(back), depth - 1);
      nodes[index].back = child;
    }
    return index;
  }

  Sides sides_of(const Piece& piece, const Plane& plane) const {
    Sides sides;
    for (const Vec3d& p : piece.points) {
      const double side = plane.side(p);
      sides.front = sides.front || side > plane_tolerance_;
      sides.back = sides.back || side < -plane_tolerance_;
    }
    return sides;
  }

  void store(std::uint32_t index, const std::vector<Piece>& pieces) {
    nodes[index].first = static_cast<std::uint32_t>(items.size());
    nodes[index].count = static_cast<std::uint32_t>(pieces.size());
    for (const Piece& piece : pieces) items.push_back(piece.shape);
  }

  /// Chooses the best plane among those of some shapes and those perpendicular to them through
  /// their edges. Returns false if none is good enough.
  bool choose(const std::vector<Piece>& pieces, Plane& best) const {
    double best_cost = kMaxPlaneCost;
    const std::size_t step = pieces.size() / kCandidates + 1;
    for (std::size_t i = step / 2; i < pieces.size(); i += step) {
      const std::span<const Vec3f> hull = shapes_.hull(pieces[i].shape);
      const Vec3d a(hull[0]), b(hull[1]), c(hull[2]);
      const Vec3d normal = normalize(cross(b - a, c - a));
      for (const Plane& plane :
           {Plane{normal, a}, Plane{normalize(cross(normal, b - a)), a},
            Plane{normalize(cross(normal, c - b)), b}, Plane{normalize(cross(normal, a - c)), c}}) {
        const double cost = plane_cost(pieces, plane);
        if (plane.normal == Vec3d{} || !(cost < best_cost)) continue;
        best_cost = cost;
        best = plane;
      }
    }
    return best_cost < kMaxPlaneCost;
  }

  /// Returns the fraction of the pieces on the side with more of them, plus half of the fraction on
  /// both sides. Estimated from up to kMaxSampled pieces.
  double plane_cost(const std::vector<Piece>& pieces, const Plane& plane) const {
    const std::size_t step = pieces.size() / kMaxSampled + 1;
    double front = 0, back = 0, both = 0, all = 0;
    for (std::size_t i = 0; i < pieces.size(); i += step) {
      const Sides sides = sides_of(pieces[i], plane);
      front += sides.front ? 1 : 0;
      back += sides.back ? 1 : 0;
      both += sides.front && sides.back ? 1 : 0;
      all += 1;
    }
    return (std::max(front, back) + 0.5 * both) / all;
  }

  const ShapeBounds& shapes_;
  const bool split_;
  double plane_tolerance_ = 0;  // maximum distance from a plane of points that lie in it
};

class PolygonBsp final : public ShapeIndex {
 public:
  PolygonBsp(const ShapeBounds& shapes, bool split) {
    Builder builder(shapes, split);
    builder.build();
    nodes_ = std::move(builder.nodes);
    items_ = std::move(builder.items);
  }

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    Mailbox mailbox;
    return descend(nodes_[0], {ray, limit, visit, mailbox, stats});
  }
  std::size_t memory_bytes() const override {
    return nodes_.capacity() * sizeof(Node) + items_.capacity() * sizeof(std::uint32_t);
  }

 private:
  bool descend(const Node& node, const ShapeTraversal& traversal) const {
    const EnterLeave t = enter_leave(traversal.ray.slabs, node.box.lo, node.box.hi);
    if (!(t.enter <= t.leave) || t.leave < 0 || t.enter > traversal.limit) return false;
    ++traversal.stats.nodes;
    if (visit_all(std::span(items_).subspan(node.first, node.count), traversal.visit,
                  traversal.mailbox)) {
      return true;
    }
    if (node.front == 0 && node.back == 0) return false;
    const double slack = traversal.ray.hull_slack;
    const double first = std::max(0.0, static_cast<double>(t.enter)) - slack;
    const double last = static_cast<double>(std::min(t.leave, traversal.limit)) + slack;
    const double start = node.plane.side(traversal.ray.origin);
    const double speed = dot(node.plane.normal, traversal.ray.direction);
    const auto side = [&](double at) { return speed == 0 ? start : start + at * speed; };
    // Covers sqrt(3), because the tolerance is per axis, and rounding.
    const double margin = 2 * traversal.ray.hit_tolerance;
    const double a = side(first), b = side(last);
    const bool front = node.front != 0 && !(std::max(a, b) < -margin);
    const bool back = node.back != 0 && !(std::min(a, b) > margin);
    if (a >= 0) {
      return (front && descend(nodes_[node.front], traversal)) ||
             (back && descend(nodes_[node.back], traversal));
    }
    return (back && descend(nodes_[node.back], traversal)) ||
           (front && descend(nodes_[node.front], traversal));
  }

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> items_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_polygon_bsp(const ShapeBounds& shapes) {
  return std::make_unique<PolygonBsp>(shapes, false);
}

std::unique_ptr<ShapeIndex> build_splitting_bsp(const ShapeBounds& shapes) {
  return std::make_unique<PolygonBsp>(shapes, true);
}

}  // namespace tessera::render::accelerators
