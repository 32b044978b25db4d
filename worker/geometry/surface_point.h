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
};

/// The point with barycentrics (1 - b1 - b2, b1, b2), computed in double and rounded once.
///
/// `tolerance` bounds, per world axis, with u = 2^-24: the rounding of the position, u |p|; that
/// of a ray origin at p transformed into object space, u |p_object|, doubled for margin; and what
/// the triangle test may be off at this triangle and neighbours as large, 6 u times the extent
/// (three sheared coordinates at 2 u, less what the box clamps); the last two taken to world
/// space by |object_to_world|.
SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2);

/// Normal and area of the placed triangle, in world units and double: |cross| / 2.
double world_area(const PlacedTriangle& triangle);

/// A ray origin on the side of the surface that `direction` points to: at least `tolerance` away
/// along the normal, and at least one float in each component the normal has.
/// Source: PBR 4e, section 6.8.6 (with tighter bounds, as positions are computed in double).
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
