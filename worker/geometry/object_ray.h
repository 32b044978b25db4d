#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "worker/geometry/bounds.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// The distance at which a ray leaves a box is multiplied by kLeaveScale, then increased by
/// ObjectRay::slack, which is kSlackScale times a distance; see enter_leave().
inline constexpr float kLeaveScale = 1 + 0x1p-20f;
inline constexpr float kSlackScale = 0x1p-21f;

/// A ray prepared for tests against the boxes and triangles of one structure, in its object space.
struct ObjectRay {
  Vec3f origin;
  Vec3f inverse;                          // 1 / direction; infinite for components below 2^-128
  std::array<std::uint8_t, 3> backwards;  // 1 where the direction's sign bit is set
  std::uint8_t kx, ky, kz;                // kz: axis of the largest |direction|
  float sx, sy, sz;                       // shear that takes the direction to the kz axis
  float slack;                            // in t; see enter_leave
};

/// v[k] by indexing instead of branches, which would be mispredicted for random directions.
inline float component(const Vec3f& v, int k) {
  const std::array<float, 3> lanes = {v.x, v.y, v.z};
  return lanes[static_cast<std::size_t>(k)];
}

/// The axis of the largest component; among equal ones the last.
inline int largest_axis(const Vec3f& size) {
  const int x_or_y = size.x > size.y ? 0 : 1;
  const float larger = size.x > size.y ? size.x : size.y;
  return larger > size.z ? x_or_y : 2;
}

/// Prepares a ray; `bounds` must contain everything it will be tested against. Returns false for an
/// origin or direction that is not finite, and for a direction that is zero or so small that
/// 1 / direction overflows in every component.
inline bool make_object_ray(const Vec3f& origin, const Vec3f& direction, const Box3f& bounds,
                            ObjectRay& ray) {
  const Vec3f size = {std::fabs(direction.x), std::fabs(direction.y), std::fabs(direction.z)};
  const int kz = largest_axis(size);
  const int kx = kz == 2 ? 0 : kz + 1, ky = kx == 2 ? 0 : kx + 1;
  const float dz = component(direction, kz);
  ray.origin = origin;
  ray.inverse = {1 / direction.x, 1 / direction.y, 1 / direction.z};
  ray.backwards = {std::signbit(direction.x), std::signbit(direction.y), std::signbit(direction.z)};
  ray.kx = static_cast<std::uint8_t>(kx);
  ray.ky = static_cast<std::uint8_t>(ky);
  ray.kz = static_cast<std::uint8_t>(kz);
  ray.sx = component(direction, kx) / dz;
  ray.sy = component(direction, ky) / dz;
  ray.sz = 1 / dz;
  const float oz = component(origin, kz);
  const float to_lo = std::fabs((component(bounds.lo, kz) - oz) * ray.sz);
  const float to_hi = std::fabs((component(bounds.hi, kz) - oz) * ray.sz);
  ray.slack = kSlackScale * (to_lo > to_hi ? to_lo : to_hi);
  // NaN anywhere makes one of these comparisons false.
  constexpr float kInf = std::numeric_limits<float>::infinity();
  return size.x < kInf && size.y < kInf && size.z < kInf && std::fabs(ray.sz) < kInf &&
         max_abs(origin) < kInf && origin.x == origin.x && origin.y == origin.y &&
         origin.z == origin.z;
}

/// Transforms a ray into object space, in double and rounded once. The direction is not normalised,
/// so t is the same in both spaces.
inline void transform_ray(const Affine3d& world_to_object, const Vec3f& origin,
                          const Vec3f& direction, Vec3f& object_origin, Vec3f& object_direction) {
  object_origin = Vec3f(transform_point(world_to_object, Vec3d(origin)));
  object_direction = Vec3f(transform_vector(world_to_object, Vec3d(direction)));
}

/// Interval of t in a box, widened at its end. The ray's line meets the box iff enter <= leave.
struct EnterLeave {
  float enter, leave;
};

/// Slab test (docs/explanation/determinism.md#closest-hit). Every step rounds monotonically, so for
/// a box inside another, enter is never smaller and leave never larger: no node is culled that
/// contains a triangle that would be hit.
///
/// `leave` is widened by 2^-20 of itself and by `slack`, which is 2^-21 of the largest distance in
/// t along kz to a plane of the whole structure. With u = 2^-24, the former covers the three
/// roundings of each slab distance (2 gamma(3) < 6.1 u) and the one of v - o in the triangle test.
/// The latter covers the shear: s * A[kz] has a relative error of 2 u, hence an error of 2 u
/// |A[kz]| |d[k] / d[kz]| in position and of 2 u |A[kz]| / |d[kz]| in t, at two vertices. So the
/// box of a triangle never rejects what its edge functions accept, which would open cracks where
/// edges lie in the faces of boxes.
///
/// A ray in a slab's plane gives 0 * inf = NaN; comparisons are then false and do not change the
/// interval, so boxes are closed. Do not build with -ffast-math.
inline EnterLeave enter_leave(const ObjectRay& ray, const Vec3f& lo, const Vec3f& hi) {
  float enter = -std::numeric_limits<float>::infinity();
  float leave = std::numeric_limits<float>::infinity();
  for (int k = 0; k < 3; ++k) {
    const bool backwards = ray.backwards[k] != 0;
    const float near = ((backwards ? hi[k] : lo[k]) - ray.origin[k]) * ray.inverse[k];
    const float far = ((backwards ? lo[k] : hi[k]) - ray.origin[k]) * ray.inverse[k];
    enter = near > enter ? near : enter;
    leave = far < leave ? far : leave;
  }
  return {enter, std::fma(leave, kLeaveScale, ray.slack)};
}

}  // namespace tessera::render
