#pragma once

#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

/// Maps from the unit square to other domains, continuous so that stratification is preserved. `u`
/// is in [0, 1)^2; densities are with respect to area or solid angle.
namespace tessera::render::warp {

inline constexpr float kPi = 3.14159265f;
inline constexpr float kInvPi = 0.318309886f;

/// Uniform point of the unit disk. Source: Shirley & Chiu, "A low distortion map between disk and
/// square", 1997.
inline Vec2f disk(Vec2f u) {
  const float x = 2 * u.x - 1, y = 2 * u.y - 1;
  if (x == 0 && y == 0) return {0, 0};
  const bool wide = std::fabs(x) > std::fabs(y);
  const float r = wide ? x : y;
  const float angle = wide ? kPi / 4 * (y / x) : kPi / 2 - kPi / 4 * (x / y);
  const elementary::SinCosf a = elementary::sincos(angle);
  return {r * a.cos, r * a.sin};
}

/// Direction in the hemisphere z >= 0 with density cos / pi. z > 0 for every u.
inline Vec3f cosine_hemisphere(Vec2f u) {
  const Vec2f d = disk(u);
  const float z2 = 1 - d.x * d.x - d.y * d.y;
  // On the rim the density would be 0: z^2 is at least the resolution of disk().
  constexpr float kLeast = 0x1p-24f;
  return {d.x, d.y, std::sqrt(z2 > kLeast ? z2 : kLeast)};
}
inline float cosine_hemisphere_pdf(float cos_theta) {
  return cos_theta > 0 ? cos_theta * kInvPi : 0;
}

/// Uniform direction in the hemisphere z >= 0, density 1 / (2 pi).
inline Vec3f uniform_hemisphere(Vec2f u) {
  const float z = 1 - u.x;
  const float r2 = u.x * (2 - u.x);  // 1 - z^2
  const elementary::SinCosf a = elementary::sincos(2 * kPi * u.y);
  const float r = std::sqrt(r2);
  return {r * a.cos, r * a.sin, z};
}
inline constexpr float kUniformHemispherePdf = kInvPi / 2;

/// Uniform direction, density 1 / (4 pi).
inline Vec3f uniform_sphere(Vec2f u) {
  const float z = 1 - 2 * u.x;
  const float r2 = 4 * u.x * (1 - u.x);  // 1 - z^2
  const elementary::SinCosf a = elementary::sincos(2 * kPi * u.y);
  const float r = std::sqrt(r2);
  return {r * a.cos, r * a.sin, z};
}
inline constexpr float kUniformSpherePdf = kInvPi / 4;

/// Barycentrics (b1, b2) of a uniformly distributed point of a triangle, by a map without square
/// root. Source: E. Heitz, "A low-distortion map between triangle and square", 2019.
inline Vec2f uniform_triangle(Vec2f u) {
  if (u.y > u.x) {
    const float b1 = u.x * 0.5f;
    return {b1, u.y - b1};
  }
  const float b2 = u.y * 0.5f;
  return {u.x - b2, b2};
}

}  // namespace tessera::render::warp
