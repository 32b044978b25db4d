#pragma once

#include "worker/geometry/ray.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// A triangle and the transforms of its instance, which are each other's inverses.
struct PlacedTriangle {
  const Affine3d& object_to_world;
  const Affine3d& world_to_object;
  Vec3f v0, v1, v2;  // object space
};

/// A point on a surface, with the error bounds needed to spawn rays there.
struct SurfacePoint {
  Vec3f position;   // world
  Vec3f normal;     // geometric, unit, world: towards the side from which v0, v1, v2 are
                    // anticlockwise in object space; zero for a degenerate triangle
  Vec3f tolerance;  // per axis: apparent distance of `position` from the surface in the tests
  float depth_tolerance = 0;  // error of a hit's depth along a ray's largest axis
};

/// The point with barycentrics (1 - b1 - b2, b1, b2), computed in double and rounded once.
///
/// With u = 2^-24, `tolerance` bounds three errors per world axis: the rounding of the position,
/// u |p|; the rounding of a ray origin at p in object space, u |p_object|; and the rounding of the
/// differences between that origin and the vertices in the triangle test, u times the extent of
/// this triangle, assuming that its neighbours are no larger. The last two are doubled for margin
/// and transformed to world space by |object_to_world|. `depth_tolerance` bounds the error of t, a
/// sum of distances along the ray's largest axis that is rounded six times (difference, reciprocal,
/// two products, two sums): 6 u times the extent.
SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2);
/// The same with world_normal(triangle) as `normal`.
SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2, const Vec3f& normal);

/// SurfacePoint::normal, computed in double and rounded once.
Vec3f world_normal(const PlacedTriangle& triangle);

/// Area of the placed triangle in world space, square metres.
double world_area(const PlacedTriangle& triangle);

/// Ray origin on the side of the surface that `direction` points to, so far along the normal that
/// the ray hits neither this surface nor another one in the same plane. The offset covers
/// `tolerance` per axis and `depth_tolerance` along `direction`. The former is 0 across a
/// coordinate plane through the origin, the latter only for directions in the plane, which see it
/// edge-on. Components that change do so by at least one float. Source: PBR 4e, section 6.8.6, with
/// tighter bounds because positions are computed in double.
Vec3f offset_ray_origin(const SurfacePoint& point, const Vec3f& direction);

/// A ray that leaves triangle `id` at `point` and cannot hit it again.
Ray spawn_ray(const SurfacePoint& point, const TriangleId& id, const Vec3f& direction);

/// A ray from `from` (on triangle `id`) to `to`, both moved off their surfaces towards each other.
/// t = 1 is `to`; t_max is 1 - 2^-20, because the target's t is rounded relative to the whole
/// length. With t_max = 1, 2 in 100,000 rays across a sphere hit their target.
Ray spawn_ray_to(const SurfacePoint& from, const TriangleId& id, const SurfacePoint& to);

/// The same to a point in free space (a punctual light).
Ray spawn_ray_to(const SurfacePoint& from, const TriangleId& id, const Vec3f& to);

}  // namespace tessera::render
