#include "worker/geometry/shapes/shape_support.h"

#include <algorithm>
#include <cmath>

#include "worker/math/transform.h"

namespace tessera::render {
namespace {

double box_support(const Box3f& box, const Vec3d& direction) {
  const Vec3d lo(box.lo), hi(box.hi);
  double sum = 0;
  for (int k = 0; k < 3; ++k) sum += direction[k] * (direction[k] < 0 ? lo[k] : hi[k]);
  return sum;
}

/// Whether all of its level sets are ellipsoids: A is positive definite (Sylvester's criterion).
bool is_ellipsoid(const Quadric& q, const Affine3d& a) {
  return q.squares.x > 0 && q.squares.x * q.squares.y > q.products.z * q.products.z &&
         determinant(a) > 0;
}

/// Support of Q(p) <= 0. With the centre m = -A^-1 b and s = b' A^-1 b - c the points are those
/// with (p - m)' A (p - m) <= s, so it is d m + sqrt(s d' A^-1 d). Infinite unless an ellipsoid.
double ellipsoid_support(const Quadric& q, const Vec3d& direction) {
  Affine3d a;
  a.rows = {q.times({1, 0, 0}), q.times({0, 1, 0}), q.times({0, 0, 1})};
  const auto inverted = inverse(a);
  if (!inverted || !is_ellipsoid(q, a)) return HUGE_VAL;
  const Vec3d centre = -transform_vector(*inverted, q.linear);
  const double size2 = -dot(centre, q.linear) - q.constant;
  const double across2 = size2 * dot(direction, transform_vector(*inverted, direction));
  return dot(direction, centre) + std::sqrt(std::max(across2, 0.0));
}

double across_axis(const Vec3d& direction) {
  return std::sqrt(direction.x * direction.x + direction.z * direction.z);
}

}  // namespace

double support(const Shape& shape, const Vec3d& direction) {
  const double box = box_support(shape.bounds, direction);
  if (shape.form == Shape::Form::torus) {
    return shape.radius * across_axis(direction) + shape.tube * length(direction);
  }
  if (shape.form != Shape::Form::quadric) return box;
  const bool cut_across = std::isfinite(shape.clip.hi.x);
  if (!cut_across && std::isfinite(shape.clip.hi.y)) {  // a surface of revolution
    const Vec3d along = {0, direction.y, 0};
    const auto radius = static_cast<double>(shape.bounds.hi.x);
    return box_support(shape.bounds, along) + radius * across_axis(direction);
  }
  return std::min(box, ellipsoid_support(shape.quadric, direction));
}

}  // namespace tessera::render
