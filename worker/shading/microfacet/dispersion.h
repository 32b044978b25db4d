#pragma once

#include <array>
#include <cmath>

#include "worker/math/vector.h"

namespace tessera::render {

/// Index of refraction at `wavelength` (nanometres) of a glass of index `ior` at 587.6 nm, with
/// `dispersion` = 20 / Abbe number; at least 1. Source: KHR_materials_dispersion (Cauchy's
/// formula).
inline float dispersed_ior(float ior, float dispersion, float wavelength) {
  const float n =
      ior + (ior - 1) * (dispersion / 20) * (523655 / (wavelength * wavelength) - 1.5168f);
  return n > 1 ? n : 1;
}

/// A sampled wavelength; its contribution counts `weight` times for R, G and B.
struct Wavelength {
  float nanometres = 0;
  Vec3f weight;
};

/// Samples a wavelength for u in [0, 1). The weights of each channel average to 1 over u, so light
/// that does not depend on wavelength keeps its colour; their sum is always 3.
///
/// A channel's sensitivity is a triangle over wavelength with its peak at the dominant wavelength
/// of the Rec. 709 primary and its ends at those of its neighbours. The eye's sensitivities for
/// these primaries are partly negative and cannot be sampling weights; the triangles keep the
/// spectral order. The sampling density is their mean.
inline Wavelength wavelength_at(float u) {
  struct Triangle {
    float low, top, high;
  };
  constexpr std::array<Triangle, 3> kChannels = {
      {{549, 611, 680}, {464, 549, 611}, {400, 464, 549}}};
  const float scaled = 3 * u;
  const int channel = scaled < 1 ? 0 : scaled < 2 ? 1 : 2;
  const Triangle& t = kChannels[static_cast<std::size_t>(channel)];
  const float v = clamp(scaled - static_cast<float>(channel), 0.0f, 1.0f);
  const float width = t.high - t.low;
  Wavelength w;
  w.nanometres = v * width < t.top - t.low ? t.low + std::sqrt(v * width * (t.top - t.low))
                                           : t.high - std::sqrt((1 - v) * width * (t.high - t.top));
  float sum = 0;
  for (int k = 0; k < 3; ++k) {
    const Triangle& c = kChannels[static_cast<std::size_t>(k)];
    const float x = w.nanometres;
    const float height =
        x < c.top ? (x - c.low) / (c.top - c.low) : (c.high - x) / (c.high - c.top);
    w.weight[k] = height > 0 ? 2 * height / (c.high - c.low) : 0;
    sum += w.weight[k];
  }
  // At the outer ends all weights are zero up to rounding: use the nearest channel.
  if (!(sum > 0)) return {w.nanometres, channel == 0 ? Vec3f{3, 0, 0} : Vec3f{0, 0, 3}};
  w.weight *= 3 / sum;
  return w;
}

}  // namespace tessera::render
