#pragma once

#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// (1 - cos)^5, Schlick's weight of the grazing colour. Requires 0 <= cos_theta <= 1.
constexpr float schlick_weight(float cos_theta) {
  const float m = clamp(1 - cos_theta, 0.0f, 1.0f);
  const float m2 = m * m;
  return m2 * m2 * m;
}

/// f0 + (1 - f0) (1 - cos)^5 per channel.
constexpr Vec3f schlick(const Vec3f& f0, float cos_theta) {
  return f0 + (Vec3f{1, 1, 1} - f0) * schlick_weight(cos_theta);
}

/// Reflectance at normal incidence between air and an index of refraction; 1 for ior 0
/// (KHR_materials_ior).
constexpr float f0_from_ior(float ior) {
  const float r = (ior - 1) / (ior + 1);
  return r * r;
}

/// Reflectance of a clearcoat (index 1.5) over the fraction `coat` of a surface for light leaving
/// at `cos_theta` (KHR_materials_clearcoat).
constexpr float coat_reflectance(float coat, float cos_theta) {
  return coat * (0.04f + 0.96f * schlick_weight(cos_theta));
}

/// Exact reflectance of unpolarised light at a smooth dielectric interface. `cos_i` is the absolute
/// cosine on the incident side, `eta` = n(other side) / n(incident side) > 0. 1 beyond the critical
/// angle; always in [0, 1].
///
/// Computes the cosine of the refracted ray as refract() does, so both agree on total reflection.
/// Source: Born & Wolf, section 1.5.2, in g = eta cos_t.
inline float fresnel_dielectric(float cos_i, float eta) {
  const float c = clamp(cos_i, 0.0f, 1.0f);
  const float g2 = (eta - 1) * (eta + 1) + c * c;  // (eta cos_t)^2, without 1 - (1 - c^2)
  if (!(g2 > 0)) return 1;
  const float g = std::sqrt(g2);
  // g - c = (eta^2 - 1) / (g + c): no cancellation for matched indices.
  const float a = (eta - 1) * (eta + 1) / ((g + c) * (g + c));
  // ((c (g + c) - 1) / (c (g - c) + 1))^2 with g - c as above: the parallel/perpendicular ratio.
  const float numerator = c * (g + c) - 1;
  const float denominator = c * (g - c) + 1;
  const float b = numerator / denominator;
  return clamp(0.5f * a * a * (1 + b * b), 0.0f, 1.0f);
}

/// Exact reflectance of unpolarised light at a smooth conductor of complex index n + ik in air.
/// `cos_i` as above, n > 0, k >= 0. Source: Born & Wolf, section 14.2, solved for the real and
/// imaginary parts p, q of (n + ik) cos_t.
inline float fresnel_conductor(float cos_i, float n, float k) {
  const float c = clamp(cos_i, 0.0f, 1.0f);
  const float c2 = c * c, s2 = (1 - c) * (1 + c);
  // Parts of (p + iq)^2, without computing 1 - s2.
  const float real = (n - 1) * (n + 1) - k * k + c2, imaginary = 2 * n * k;
  const float modulus = std::sqrt(real * real + imaginary * imaginary);
  // The smaller of p^2 and q^2 follows from their product: no cancellation.
  const float larger = 0.5f * (modulus + std::fabs(real));
  const float p2 = real >= 0 || !(larger > 0) ? larger : 0.25f * imaginary * imaginary / larger;
  const float twice = 2 * c * std::sqrt(p2);
  if (!(modulus + c2 + twice > 0)) return 1;  // grazing, at a matched index
  const float perpendicular = (modulus + c2 - twice) / (modulus + c2 + twice);
  const float along = c2 * modulus + s2 * s2;
  const float parallel = perpendicular * (along - twice * s2) / (along + twice * s2);
  return clamp(0.5f * (perpendicular + parallel), 0.0f, 1.0f);
}

/// Refracts `w` (unit, pointing away from the surface) about the unit normal `n` on w's side.
/// Returns false in total reflection; otherwise `wt` points to the other side. `eta` as above.
inline bool refract(const Vec3f& w, const Vec3f& n, float eta, Vec3f* wt) {
  const float c = dot(w, n);
  const float g2 = (eta - 1) * (eta + 1) + c * c;
  if (!(g2 > 0)) return false;
  const float g = std::sqrt(g2);
  *wt = (n * (c - g) - w) / eta;
  return true;
}

/// Mean transmittance 1 - F over the cosine-weighted hemisphere on the denser side of a smooth
/// dielectric interface. On the other side it is n^2 times as much. `ior` > 0 is the ratio of the
/// indices, either way. Source: Walsh's closed form of the diffuse Fresnel reflectance, in Duntley
/// 1942, J. Opt. Soc. Am. 32, 61.
inline float mean_transmittance_from_dense(float ior) {
  const double n = ior > 1 ? ior : 1 / static_cast<double>(ior);
  if (n < 1.001) return 1;  // the terms below would cancel; F is negligible up to grazing angles
  const double n2 = n * n, n4 = n2 * n2, up = n + 1, sum = n2 + 1, difference = n4 - 1;
  const double reflected =
      0.5 + (n - 1) * (3 * n + 1) / (6 * up * up) +
      n2 * (n2 - 1) * (n2 - 1) / (sum * sum * sum) * elementary::log((n - 1) / up) -
      2 * n2 * n * (n2 + 2 * n - 1) / (sum * difference) +
      8 * n4 * (n4 + 1) / (sum * difference * difference) * elementary::log(n);
  return static_cast<float>((1 - reflected) / n2);
}

/// Mean of Schlick's Fresnel reflectance over the cosine-weighted hemisphere: f0 + (1 - f0) / 21.
constexpr Vec3f schlick_average(const Vec3f& f0) {
  return f0 + (Vec3f{1, 1, 1} - f0) * (1.0f / 21);
}

}  // namespace tessera::render
