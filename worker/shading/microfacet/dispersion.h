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

/// One wavelength, standing for all: what is carried at it counts `weight` times for R, G and B.
struct Wavelength {
  float nanometres = 0;
  Vec3f weight;
};

/// A wavelength for u in [0, 1). Over u the weights of each channel average to 1, so that what does
/// not depend on wavelength keeps its colour; their sum is always 3.
///
/// A channel's sensitivity is a triangle over wavelength with its top at the dominant wavelength of
/// the Rec. 709 primary and its feet at those of its neighbours: not the eye's, whose red, green
/// and blue have negative parts that no sampling weight should have, but the same spectral order.
/// Drawn from their mean.
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
  // On the outer feet all are zero: what rounding puts there is given to the nearest channel.
  if (!(sum > 0)) return {w.nanometres, channel == 0 ? Vec3f{3, 0, 0} : Vec3f{0, 0, 3}};
  w.weight *= 3 / sum;
  return w;
}

}  // namespace tessera::render
