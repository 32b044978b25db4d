#pragma once

#include <cmath>

#include "worker/geometry/frame.h"
#include "worker/math/elementary.h"
#include "worker/math/vector.h"
#include "worker/sampling/warp.h"

/// Henyey & Greenstein's phase function, 1941: (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^1.5), g the
/// mean cosine. Computed from 1 - cos, which keeps the peak accurate for |g| near 1.
namespace tessera::render::phase {

/// 1 - cos of the angle between unit vectors, from their difference.
inline float versine(const Vec3f& a, const Vec3f& b) {
  const Vec3f d = a - b;
  return 0.5f * dot(d, d);
}

/// Density over solid angle of scattering from `from` to `to` (both unit, in the direction in which
/// light travels, or both reversed).
inline float density(float g, const Vec3f& from, const Vec3f& to) {
  // Uses |g|: a backward peak is a forward peak in the opposite direction.
  const float a = std::fabs(g);
  const float v = versine(g < 0 ? -from : from, to);
  const float s = (1 - a) * (1 - a) + 2 * a * v;
  return warp::kInvPi / 4 * (1 - a) * (1 + a) / (s * std::sqrt(s));
}

/// Samples a direction with that density for u in [0, 1)^2.
inline Vec3f sample(float g, const Vec3f& from, Vec2f u) {
  const float a = std::fabs(g);
  // The inverse CDF, solved for 1 - cos without cancellation or division by g.
  const float below = 1 - a + 2 * a * u.x;
  const float v = (1 - a) * (1 - u.x) * ((1 - a) * (1 + a) / below + 1 - a) / below;
  const float versed = clamp(v, 0.0f, 2.0f);
  const float sine = std::sqrt(versed * (2 - versed));
  const elementary::SinCosf angle = elementary::sincos(2 * warp::kPi * u.y);
  const Frame frame = Frame::from_normal(g < 0 ? -from : from);
  return normalize(frame.to_world({sine * angle.cos, sine * angle.sin, 1 - versed}));
}

}  // namespace tessera::render::phase
