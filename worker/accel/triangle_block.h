#pragma once

#include <array>
#include <cstdint>

#include "worker/accel/lanes.h"
#include "worker/geometry/object_ray.h"
#include "worker/geometry/ray.h"
#include "worker/geometry/triangle.h"

namespace tessera::render {

/// Up to eight triangles, coordinates in lanes. Unused lanes hold a point (a zero determinant).
struct alignas(32) TriangleBlock {
  std::array<std::array<std::array<float, 8>, 3>, 3> v;  // [vertex][axis][lane]
  std::array<std::uint32_t, 8> primitive, triangle;
};

/// What intersect_block found; only the lanes in the returned mask mean anything.
struct BlockHits {
  alignas(32) std::array<float, 8> t, b0, b1, b2;
};

/// intersect_triangle() of geometry/triangle.h for each lane, bit for bit. Returns the lanes that
/// accept.
inline std::uint32_t intersect_block(const ObjectRay& ray, const TriangleBlock& block,
                                     BlockHits& hits) {
  const auto corner = [&](int vertex, int axis) { return load(block.v[vertex][axis].data()); };
  const Lanes ox = splat(ray.origin[ray.kx]), oy = splat(ray.origin[ray.ky]),
              oz = splat(ray.origin[ray.kz]);
  const Lanes sx = splat(ray.sx), sy = splat(ray.sy);
  const Lanes az = corner(0, ray.kz) - oz, bz = corner(1, ray.kz) - oz, cz = corner(2, ray.kz) - oz;
  const Lanes ax = (corner(0, ray.kx) - ox) - sx * az, ay = (corner(0, ray.ky) - oy) - sy * az;
  const Lanes bx = (corner(1, ray.kx) - ox) - sx * bz, by = (corner(1, ray.ky) - oy) - sy * bz;
  const Lanes cx = (corner(2, ray.kx) - ox) - sx * cz, cy = (corner(2, ray.ky) - oy) - sy * cz;
  const Lanes u = difference_of_products(cx, by, cy, bx);
  const Lanes v = difference_of_products(ax, cy, ay, cx);
  const Lanes w = difference_of_products(bx, ay, by, ax);
  const Lanes zero = _mm256_setzero_ps();
  const auto compare = [&](auto predicate) {
    constexpr int kPredicate = decltype(predicate)::value;
    return _mm256_and_ps(
        _mm256_and_ps(_mm256_cmp_ps(u, zero, kPredicate), _mm256_cmp_ps(v, zero, kPredicate)),
        _mm256_cmp_ps(w, zero, kPredicate));
  };
  const Lanes same_sign = _mm256_or_ps(compare(std::integral_constant<int, _CMP_GE_OQ>()),
                                       compare(std::integral_constant<int, _CMP_LE_OQ>()));
  if (bits(same_sign) == 0) return 0;
  const Lanes determinant = (u + v) + w;
  const Lanes accepted = _mm256_and_ps(same_sign, _mm256_cmp_ps(determinant, zero, _CMP_NEQ_UQ));
  if (bits(accepted) == 0) return 0;
  const Lanes b0 = u / determinant, b1 = v / determinant, b2 = w / determinant;
  const Lanes sz = splat(ray.sz);
  Lanes t = (b0 * (sz * az) + b1 * (sz * bz)) + b2 * (sz * cz);
  Lanes enter = splat(-std::numeric_limits<float>::infinity());
  Lanes leave = splat(std::numeric_limits<float>::infinity());
  for (int k = 0; k < 3; ++k) {
    const Lanes lo = lesser(lesser(corner(0, k), corner(1, k)), corner(2, k));
    const Lanes hi = greater(greater(corner(0, k), corner(1, k)), corner(2, k));
    const bool backwards = ray.backwards[k] != 0;
    const Lanes origin = splat(ray.origin[k]), inverse = splat(ray.inverse[k]);
    enter = greater(enter, ((backwards ? hi : lo) - origin) * inverse);
    leave = lesser(leave, ((backwards ? lo : hi) - origin) * inverse);
  }
  leave = fused_multiply_add(leave, splat(kLeaveScale), splat(ray.slack));
  t = greater(t, enter);
  t = lesser(t, leave);
  _mm256_store_ps(hits.t.data(), t);
  _mm256_store_ps(hits.b0.data(), b0);
  _mm256_store_ps(hits.b1.data(), b1);
  _mm256_store_ps(hits.b2.data(), b2);
  return bits(_mm256_and_ps(accepted, _mm256_cmp_ps(enter, leave, _CMP_LE_OQ)));
}

}  // namespace tessera::render
