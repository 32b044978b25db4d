#pragma once

#include "worker/math/vector.h"

namespace tessera::render {

/// Diffuse reflection by rough facets that loses no energy, in place of Lambert's: what EON says of
/// albedo `rho` and roughness r. Source: J. Portsmouth, P. Kutz & S. Hill, "EON: A practical
/// energy-preserving rough diffuse BRDF", JCGT 14(1), 2025.
struct RoughDiffuse {
  float roughness = 0;  // r, [0, 1]; 0: Lambert's
  Vec3f multiple;       // factor of (1 - E(wi)): light that facets pass on to each other, per rho
};

namespace eon {

inline constexpr float kPi = 3.14159265f;
inline constexpr float kSingle = 0.5f - 2 / (3 * kPi);  // of r, in the loss of one scattering
inline constexpr float kAverage = 2.0f / 3 - 28 / (15 * kPi);  // of r, in its mean over directions

/// Share of light along cosine `mu` that white facets scatter once; the paper's fit, to 1e-3.
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

/// For a viewer at cosine `cos_o`.
inline RoughDiffuse make_rough_diffuse(const Vec3f& rho, float roughness, float cos_o) {
  RoughDiffuse d;
  d.roughness = roughness;
  const float average = eon::average_albedo(roughness), lost = 1 - average;
  if (!(lost > 0)) return d;
  const float from_o = 1 - eon::single_albedo(cos_o, roughness);
  d.multiple = rho * (average * (from_o > 0 ? from_o : 0) / lost) / (Vec3f{1, 1, 1} - rho * lost);
  return d;
}

/// What Lambert's rho / pi is multiplied by; directions in the shading frame, z > 0.
inline Vec3f rough_diffuse(const RoughDiffuse& d, const Vec3f& wo, const Vec3f& wi) {
  const float s = dot(wo, wi) - wo.z * wi.z;
  const float larger = wo.z > wi.z ? wo.z : wi.z;
  const float retro = s > 0 ? s / larger : s;
  const float once = (1 + d.roughness * retro) / (1 + eon::kSingle * d.roughness);
  const float from_i = 1 - eon::single_albedo(wi.z, d.roughness);
  return Vec3f{once, once, once} + d.multiple * (from_i > 0 ? from_i : 0);
}

}  // namespace tessera::render
