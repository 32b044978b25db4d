#pragma once

#include <span>
#include <vector>

#include "worker/math/vector.h"

namespace tessera::render {

// Convex polygons are lists of vertices, ordered so that turning from +x to +y goes forward: areas
// are positive.

/// The least convex polygon around the points; fewer than three vertices if it has no area.
std::vector<Vec2d> convex_hull(std::vector<Vec2d> points);

/// The part of a convex polygon with low <= x, y <= high. It may have the area 0.
std::vector<Vec2d> part_in_square(std::span<const Vec2d> polygon, double low, double high);

/// 0 with fewer than three vertices.
double area_of(std::span<const Vec2d> polygon);

/// Centre of mass. Requires an area.
Vec2d centre_of(std::span<const Vec2d> polygon);

/// Distribution of points: two thirds are uniform in a convex polygon, the others beyond it, with a
/// density that falls with the sixth power of the distance from the centre.
class AroundPolygon {
 public:
  /// `outline` must outlive this. Requires an area.
  AroundPolygon(std::span<const Vec2d> outline, const Vec2d& centre, double area)
      : outline_(outline), centre_(centre), area_(area) {}

  /// For u in [0, 1)^2.
  Vec2f sample(const Vec2f& u) const;
  /// Density of sample() per unit area.
  double density(const Vec2f& point) const;

 private:
  std::span<const Vec2d> outline_;
  Vec2d centre_;
  double area_;
};

}  // namespace tessera::render
