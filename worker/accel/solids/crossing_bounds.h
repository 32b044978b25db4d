#pragma once

#include "worker/geometry/ray.h"
#include "worker/geometry/shape.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// A ray's line in the object space of an operand, in double. `recentring` is the translation that
/// was subtracted from world space, Scene::center. Refers to its arguments.
struct OperandLine {
  const Affine3d& world_to_object;
  const Ray& ray;
  const Vec3d& recentring;
  Vec3d origin = transform_point(world_to_object, Vec3d(ray.origin));
  Vec3d direction = transform_vector(world_to_object, Vec3d(ray.direction));
};

/// Where a line crosses a surface, in multiples of the ray's direction.
struct CrossingBounds {
  double t = 0;
  double rounding = 0;  // bounds the error of t for the surface as it is stored
  double error = 0;     // bounds the error of t for the surface that the stored one approximates
};

/// Bounds the error of a shape's hit: kOperandRoundings roundings of double of the coordinates
/// along the surface's normal, divided by the cosine of the angle of incidence. A shape is taken to
/// be exact, so `error` is `rounding`.
CrossingBounds shape_crossing(const OperandLine& line, const Shape& shape, const ShapeHit& hit);

/// Intersects the line with the plane of a triangle, in double. The float test that found the
/// triangle may accept a line that passes beside it, so t is clamped to the range of the triangle
/// along the line. `error` also includes the rounding of the vertices: kVertexRoundings roundings
/// of float of the largest coordinate. Inside a triangle the error is a convex combination of the
/// errors of its vertices, so that the bound holds for slivers too.
CrossingBounds triangle_crossing(const OperandLine& line, const Vec3d& v0, const Vec3d& v1,
                                 const Vec3d& v2);

/// Number of roundings in the coordinates of an operand: the composition of its ancestors'
/// transforms, the inverse, the transform of the ray and the intersection. An inverse needs about
/// 20, each ancestor and each of the others 4.
inline constexpr double kOperandRoundings = 256;

/// Number of roundings in a vertex: an affine transform applied in float before it is stored.
inline constexpr double kVertexRoundings = 4;

}  // namespace tessera::render
