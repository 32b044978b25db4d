#pragma once

#include "worker/math/vector.h"

namespace tessera::render {

/// Energy-preserving rough diffuse reflection (EON) in place of Lambert's, for albedo `rho` and
/// roughness r. Source: J. Portsmouth, P. Kutz & S. Hill, "EON: A practical energy-preserving rough
/// diffuse BRDF", JCGT 14(1), 2025.
struct RoughDiffuse {
  float roughness = 0;  // r, [0, 1]; 0: Lambert
  Vec3f multiple;       // factor of (1 - E(wi)) for interreflection between facets, relative to rho
};

namespace eon {

inline constexpr float kPi = 3.14159265f;
inline constexpr float kSingle = 0.5f - 2 / (3 * kPi);  // per r: energy lost by single scattering
inline constexpr float kAverage = 2.0f / 3 - 28 / (15 * kPi);  // per r: its mean over directions

/// Single-scattering albedo of white facets at cosine `mu`; the paper's fit, accurate to 1e-3.
inline float single_albedo(float mu, float r) {
  const float m = 1 - mu;
  const float g =
      m * (0.0571085289f + m * (0.491881867f + m * (-0.332181442f + m * 0.0714429953f)));
  return (1 + r * g) / (1 + kSingle * r);
}

inline float average_albedo(float r) {
  return (1 + kAverage * r) / (1 + kSingle * r);
}

}  // namespace eon

/// Prepares the reflection for a viewer at cosine `cos_o`.
inline RoughDiffuse make_rough_diffuse(const Vec3f& rho, float roughness, float cos_o) {
  RoughDiffuse d;
  d.roughness = roughness;
  const float average = eon::average_albedo(roughness), lost = 1 - average;
  if (!(lost > 0)) return d;
  const float from_o = 1 - eon::single_albedo(cos_o, roughness);
  d.multiple = rho * (average * (from_o > 0 ? from_o : 0) / lost) / (Vec3f{1, 1, 1} - rho * lost);
  return d;
}

/// Factor of Lambert's rho / pi; directions in the shading frame, z > 0.
inline Vec3f rough_diffuse(const RoughDiffuse& d, const Vec3f& wo, const Vec3f& wi) {
  const float s = dot(wo, wi) - wo.z * wi.z;
  const float larger = wo.z > wi.z ? wo.z : wi.z;
  const float retro = s > 0 ? s / larger : s;
  const float once = (1 + d.roughness * retro) / (1 + eon::kSingle * d.roughness);
  const float from_i = 1 - eon::single_albedo(wi.z, d.roughness);
  return Vec3f{once, once, once} + d.multiple * (from_i > 0 ? from_i : 0);
}

}  // namespace tessera::render
