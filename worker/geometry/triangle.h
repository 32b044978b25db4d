#pragma once

#include "worker/geometry/object_ray.h"

namespace tessera::render {

/// Whether a triangle can be hit: it is finite and its corners are not collinear, by a cross
/// product in double that is exact unless coordinates differ by more than 2^29. Collinear triangles
/// are left out of all structures because the rounding of the shear would make some of them
/// visible.
inline bool is_hittable(const Vec3f& v0, const Vec3f& v1, const Vec3f& v2) {
  const Vec3d origin(v0);
  return is_finite(v0) && is_finite(v1) && is_finite(v2) &&
         cross(Vec3d(v1) - origin, Vec3d(v2) - origin) != Vec3d{};
}

/// Intersection of a ray's line with a triangle; t may be negative.
struct TriangleHit {
  float t, b0, b1, b2;
};

/// Intersects the ray's line with a triangle, from both sides
/// (docs/explanation/determinism.md#closest-hit). The line hits if Woop's sheared edge functions,
/// with Kahan's difference of products, and the triangle's box accept it; t is clamped to the box.
/// Watertight: every line through a shared edge or vertex hits one of the triangles that share it.
/// A zero determinant (a triangle seen edge-on) and NaN never hit. Requires is_hittable().
///
/// No intermediate exceeds a length squared, so coordinates up to 1e18 do not overflow. The signs
/// of the edge functions are exact while products of sheared coordinates are above 2^-101.
///
/// Reference for accel/layout/triangle_block.h, which performs the same operations in lanes.
/// Source: S. Woop, C. Benthin, I. Wald, "Watertight ray/triangle intersection", JCGT 2(1), 2013.
inline bool intersect_triangle(const ObjectRay& ray, const Vec3f& v0, const Vec3f& v1,
                               const Vec3f& v2, TriangleHit& hit) {
  const Vec3f a = v0 - ray.origin, b = v1 - ray.origin, c = v2 - ray.origin;
  const float ax = a[ray.kx] - ray.sx * a[ray.kz], ay = a[ray.ky] - ray.sy * a[ray.kz];
  const float bx = b[ray.kx] - ray.sx * b[ray.kz], by = b[ray.ky] - ray.sy * b[ray.kz];
  const float cx = c[ray.kx] - ray.sx * c[ray.kz], cy = c[ray.ky] - ray.sy * c[ray.kz];
  const float u = difference_of_products(cx, by, cy, bx);
  const float v = difference_of_products(ax, cy, ay, cx);
  const float w = difference_of_products(bx, ay, by, ax);
  const bool all_positive = u >= 0 && v >= 0 && w >= 0;
  const bool all_negative = u <= 0 && v <= 0 && w <= 0;
  if (!all_positive && !all_negative) return false;
  const float determinant = u + v + w;
  if (determinant == 0) return false;
  hit.b0 = u / determinant;
  hit.b1 = v / determinant;
  hit.b2 = w / determinant;
  hit.t =
      hit.b0 * (ray.sz * a[ray.kz]) + hit.b1 * (ray.sz * b[ray.kz]) + hit.b2 * (ray.sz * c[ray.kz]);
  const EnterLeave box = enter_leave(ray, min(min(v0, v1), v2), max(max(v0, v1), v2));
  if (!(box.enter <= box.leave)) return false;
  hit.t = hit.t < box.enter ? box.enter : hit.t;
  hit.t = hit.t > box.leave ? box.leave : hit.t;
  return true;
}

}  // namespace tessera::render
