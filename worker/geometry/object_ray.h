#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "worker/geometry/bounds.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// The leave distances of boxes are widened by this fraction of themselves, and by
/// ObjectRay::slack (see enter_leave).
inline constexpr float kLeaveScale = 1 + 0x1p-20f;
inline constexpr float kSlackScale = 0x1p-21f;

/// A ray made ready for the boxes and triangles of one structure, in its object space.
struct ObjectRay {
  Vec3f origin;
  Vec3f inverse;                          // 1 / direction; infinite where it is 0 or below 2^-128
  std::array<std::uint8_t, 3> backwards;  // 1 where the direction's sign bit is set
  std::uint8_t kx, ky, kz;                // kz: axis of the largest |direction|
  float sx, sy, sz;                       // shear that takes the direction to the kz axis
  float slack;                            // in t; see enter_leave
};

/// v[k] by an address rather than by branches, which random directions would mispredict.
inline float component(const Vec3f& v, int k) {
  const std::array<float, 3> lanes = {v.x, v.y, v.z};
  return lanes[static_cast<std::size_t>(k)];
}

/// The axis of the largest component; the last of those that are equal, z of all.
inline int largest_axis(const Vec3f& size) {
  const int x_or_y = size.x > size.y ? 0 : 1;
  const float larger = size.x > size.y ? size.x : size.y;
  return larger > size.z ? x_or_y : 2;
}

/// Makes the ray. `bounds` must hold all that will be tested against it. False for a direction
/// that is zero, not finite, or so small that 1 / direction overflows in every component.
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

/// The ray's origin and direction in an instance's space, by `world_to_object` in double and
/// rounded once; the direction is not normalised, so t means the same in both spaces.
inline void transform_ray(const Affine3d& world_to_object, const Vec3f& origin,
                          const Vec3f& direction, Vec3f& object_origin, Vec3f& object_direction) {
  object_origin = Vec3f(transform_point(world_to_object, Vec3d(origin)));
  object_direction = Vec3f(transform_vector(world_to_object, Vec3d(direction)));
}

/// The t at which the ray enters a box and the widened one at which it leaves it; the box is met
/// iff enter <= leave (t >= 0 apart).
struct EnterLeave {
  float enter, leave;
};

/// The slab test of "One hit". Every step rounds monotonically, so for a box inside another,
/// enter is never smaller and leave never larger: a node cannot be culled for a triangle in it
/// that would be hit.
///
/// `leave` is widened by 2^-20 of itself and by `slack`, 2^-21 of the largest distance in t along
/// kz to a plane of the whole structure. With u = 2^-24 the former covers the three roundings of
/// each slab distance (2 gamma(3) < 6.1 u) and that of v - o in the triangle test; the latter
/// covers the shear (relative error of s * A[kz]: 2 u, hence 2 u |A[kz]| |d[k] / d[kz]| in place
/// and 2 u |A[kz]| / |d[kz]| in t, at two vertices). So the box of a triangle does not reject
/// what its edge functions accept, which would tear a mesh where edges lie in box faces.
///
/// A ray in a slab's plane gives 0 * inf = NaN; comparisons are then false and leave the interval
/// as it was, so boxes are closed. Do not build with -ffast-math.
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
