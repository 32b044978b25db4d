#pragma once

#include <cstddef>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Fibres of KHR_materials_sheen: inverted Gaussian normals ("Charlie") with Estevez & Kulla's
/// shadowing. Source: A. Conty Estevez, C. Kulla, "Production Friendly Microfacet Sheen BRDF",
/// 2017, equation 2, section 3 and its table of fitted constants.

/// Minimum perceptual roughness; below it the lobe would not reach any direction of the
/// hemisphere's light.
inline constexpr float kMinSheenRoughness = 0.07f;

template <typename T>
inline T sheen_alpha(T roughness) {
  const T r = roughness > T(kMinSheenRoughness) ? roughness : T(kMinSheenRoughness);
  return r * r;
}

/// Density of fibre normals; `sin2` is the squared sine of the half vector's angle.
template <typename T>
inline T sheen_d(T sin2, T alpha) {
  const T power = 1 / alpha;
  return (2 + power) * elementary::pow(sin2, T(0.5) * power) * T(0.15915494309189533577);
}

/// Fitted curve whose exponential is Lambda, for cos up to 1/2.
template <typename T>
inline T sheen_curve(T x, T alpha) {
  const T k = (1 - alpha) * (1 - alpha);
  const T a = lerp(T(21.5473), T(25.3245), k), b = lerp(T(3.82987), T(3.32435), k);
  const T c = lerp(T(0.19823), T(0.16801), k), d = lerp(T(-1.97760), T(-1.27393), k);
  const T e = lerp(T(-4.32054), T(-4.85967), k);
  return a / (1 + b * elementary::pow(x, c)) + d * x + e;
}

/// Smith's Lambda of the fibres, cos_theta in [0, 1].
template <typename T>
inline T sheen_lambda(T cos_theta, T alpha) {
  if (cos_theta < T(0.5)) return elementary::exp(sheen_curve(cos_theta, alpha));
  return elementary::exp(2 * sheen_curve(T(0.5), alpha) - sheen_curve(1 - cos_theta, alpha));
}

/// Directional albedo of white sheen over (cosine, perceptual roughness). Above 1 for narrow lobes
/// at grazing angles, for which the model was not made. Tabulated when Tessera is built
/// (make_tables/main.cpp), rounded up.
///
/// Grid: kSheenCosines points in cos = (i / (n - 1))^4, kSheenRows points in roughness from
/// kMinSheenRoughness to 1; bilinear in between.
inline constexpr std::size_t kSheenCosines = 64, kSheenRows = 32;

float sheen_albedo(float cosine, float roughness);

}  // namespace tessera::render
