#include "worker/shading/microfacet/thin_film.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/shading/microfacet/fresnel.h"

namespace tessera::render {
namespace {

constexpr float kPi = 3.14159265f;

float square(float x) {
  return x * x;
}

/// Reflectance between media of indices `n1` and `n2` at normal incidence.
float normal_reflectance(float n1, float n2) {
  return square((n2 - n1) / (n2 + n1));
}

float schlick(float f0, float cos_theta) {
  return f0 + (1 - f0) * schlick_weight(cos_theta);
}

/// A Gaussian of a colour matching function in Fourier space: `value` is its integral; `position`
/// in 1/m and `variance` in 1/m^2. Source: Belcour & Barla 2017, section 4.
struct Gaussian {
  float value, position, variance;

  /// Its contribution to cos(2 pi opd / lambda + shift), normalised by its area.
  float at(float phase, float shift) const {
    return value * std::sqrt(2 * kPi * variance) * elementary::cos(position * phase + shift) *
           elementary::exp(-square(phase) * variance);
  }
};

constexpr std::array<Gaussian, 4> kMatching = {{{5.4856e-13f, 1.6810e+06f, 4.3278e+09f},
                                                {4.4201e-13f, 1.7953e+06f, 9.3046e+09f},
                                                {5.2481e-13f, 2.2084e+06f, 6.6121e+09f},
                                                {9.7470e-14f, 2.2399e+06f, 4.5282e+09f}}};
constexpr float kYIntegral = 1.0685e-7f;

/// RGB of an equal-energy spectrum weighted by the cosine of its phase over an optical path
/// difference `opd` (nanometres) plus `shift` (radians, per channel).
Vec3f sensitivity(float opd, const Vec3f& shift) {
  const float phase = 2 * kPi * opd * 1e-9f;
  const float x = (kMatching[0].at(phase, shift.x) + kMatching[3].at(phase, shift.x)) / kYIntegral;
  const float y = kMatching[1].at(phase, shift.y) / kYIntegral;
  const float z = kMatching[2].at(phase, shift.z) / kYIntegral;
  return {3.2404542f * x - 1.5371385f * y - 0.4985314f * z,
          -0.9692660f * x + 1.8760108f * y + 0.0415560f * z,
          0.0556434f * x - 0.2040259f * y + 1.0572252f * z};
}

}  // namespace

Vec3f thin_film_reflectance(const ThinFilm& film, const Vec3f& f0, float cos_theta) {
  // The effect of very thin films fades out.
  const float fade = clamp(film.thickness / 0.03f, 0.0f, 1.0f);
  const float ior = lerp(1.0f, film.ior, fade * fade * (3 - 2 * fade));
  const float cos2 = 1 - square(1 / ior) * (1 - square(cos_theta));
  if (!(cos2 > 0)) return {1, 1, 1};  // total reflection
  const float cos_inside = std::sqrt(cos2);
  const float r12 = schlick(normal_reflectance(1, ior), cos_theta);
  const float t121 = 1 - r12;
  Vec3f r23, shift, r123, rs;
  for (int k = 0; k < 3; ++k) {
    const float root = std::sqrt(clamp(f0[k], 0.0f, 0.9999f));
    const float base_ior = (1 + root) / (1 - root);
    r23[k] = schlick(normal_reflectance(ior, base_ior), cos_inside);
    // Phase shifts of half a wave: always at the film's top, and at its bottom if the base has a
    // lower index than the film.
    shift[k] = kPi + (base_ior < ior ? kPi : 0.0f);
    r123[k] = clamp(r12 * r23[k], 0.0f, 0.9999f);
    rs[k] = square(t121) * r23[k] / (1 - r123[k]);
  }
  Vec3f sum = Vec3f{r12, r12, r12} + rs;
  Vec3f amplitude = rs - Vec3f{t121, t121, t121};
  const float opd = 2 * ior * film.thickness * cos_inside;
  for (int m = 1; m <= 2; ++m) {
    const auto order = static_cast<float>(m);
    for (int k = 0; k < 3; ++k) amplitude[k] *= std::sqrt(r123[k]);
    sum += amplitude * sensitivity(order * opd, shift * order) * 2.0f;
  }
  return max(min(sum, Vec3f{1, 1, 1}), Vec3f{});
}

float thin_film_cap(const ThinFilm& film, const Vec3f& f0, float exact_ior) {
  constexpr int kSteps = 40;
  const float normal = f0_from_ior(exact_ior);
  float cap = 0;
  for (int i = 0; i < kSteps; ++i) {
    // Up to 89.95 degrees, densest there, where both terms come near 1.
    const float x = 0.03f + 0.97f * (static_cast<float>(i) / (kSteps - 1)), c = x * x;
    const float s = exact_ior > 0 ? (fresnel_dielectric(c, exact_ior) - normal) / (1 - normal)
                                  : schlick_weight(c);
    const float f = max_component(thin_film_reflectance(film, f0, c));
    cap = std::max(cap, (f - s) / (1 - s));
  }
  return std::min(cap + 0.002f, 1.0f);  // fringes may peak between the samples
}

}  // namespace tessera::render
