#pragma once

#include "worker/geometry/ray.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// A triangle as its instance places it. The transforms are each other's inverses.
struct PlacedTriangle {
  const Affine3d& object_to_world;
  const Affine3d& world_to_object;
  Vec3f v0, v1, v2;  // object space
};

/// A point on a surface with what is needed to start rays there.
struct SurfacePoint {
  Vec3f position;   // world
  Vec3f normal;     // geometric, unit, world: the side from which v0, v1, v2 turn anticlockwise
                    // in object space, whatever the determinant; zero for a degenerate triangle
  Vec3f tolerance;  // per axis: how far off the surface `position`, transformed back, may seem
  float depth_tolerance = 0;  // how far off a hit's depth may seem, along a ray's largest axis
};

/// The point with barycentrics (1 - b1 - b2, b1, b2), computed in double and rounded once.
///
/// With u = 2^-24, `tolerance` bounds, per world axis, the rounding of the position, u |p|; that of
/// a ray origin at p transformed into object space, u |p_object|; and that of the differences
/// between such an origin and the vertices in the triangle test, u times the extent of this
/// triangle and neighbours as large; the last two doubled for margin and taken to world space by
/// |object_to_world|. `depth_tolerance` bounds t: a sum of distances along the ray's largest axis,
/// each rounded six times (difference, reciprocal, two products, two sums), 6 u times the extent.
SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2);
/// The same where world_normal(triangle) is known already.
SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2, const Vec3f& normal);

/// SurfacePoint::normal alone, worked out in double and rounded once.
Vec3f world_normal(const PlacedTriangle& triangle);

/// Normal and area of the placed triangle, in world units and double: |cross| / 2.
double world_area(const PlacedTriangle& triangle);

/// A ray origin on the side of the surface that `direction` points to, so far along the normal that
/// the triangle test finds neither this surface nor one in the same plane before it: per axis
/// `tolerance`, and what `depth_tolerance` makes of `direction`. The former is 0 across a
/// coordinate plane through the origin, the latter only for directions in the plane, which see it
/// edge-on. Components that move do so by at least one float. Source: PBR 4e, section 6.8.6 (with
/// tighter bounds, as positions are computed in double).
Vec3f offset_ray_origin(const SurfacePoint& point, const Vec3f& direction);

/// A ray that leaves triangle `id` at `point` and cannot hit it again.
Ray spawn_ray(const SurfacePoint& point, const TriangleId& id, const Vec3f& direction);

/// A ray from `from` (on triangle `id`) to `to`, both moved off their surfaces towards each other:
/// t = 1 is `to`. t_max is 1 - 2^-20, as the t of the target itself rounds relative to the whole
/// length: measured, 2 in 100,000 rays across a sphere would else hit their target.
Ray spawn_ray_to(const SurfacePoint& from, const TriangleId& id, const SurfacePoint& to);

/// The same to a point in free space (a punctual light).
Ray spawn_ray_to(const SurfacePoint& from, const TriangleId& id, const Vec3f& to);

}  // namespace tessera::render
