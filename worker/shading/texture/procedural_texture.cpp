#include "worker/shading/texture/procedural_texture.h"

#include <cmath>

#include "worker/math/elementary.h"
#include "worker/sampling/gradient_noise.h"
#include "worker/sampling/value_noise.h"

namespace tessera::render {

namespace {

constexpr float kTwoPi = 6.28318531f;

/// Visible amplitude of waves with `frequency` periods per footprint: 1 up to half a period, which
/// samples can resolve, 0 from one period on.
float visible_amplitude(float waves) {
  return clamp(2 - 2 * waves, 0.0f, 1.0f);
}

float smooth_step(float low, float high, float x) {
  const float f = clamp((x - low) / (high - low), 0.0f, 1.0f);
  return f * f * (3 - 2 * f);
}

/// Iterates over octaves of noise: frequency times lacunarity, amplitude times gain.
class Octaves {
 public:
  Octaves(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint)
      : procedural_(procedural), p_(p), waves_(footprint) {}

  float amplitude() const { return amplitude_; }
  float visibility() const { return visible_amplitude(waves_); }

  /// Noise of the current octave; 0 if it is finer than the footprint.
  float noise() const {
    if (!(waves_ < 1)) return 0;
    return gradient_noise(procedural_.dimensions, p_,
                          procedural_.seed + static_cast<std::uint32_t>(octave_));
  }

  bool next() {
    if (++octave_ >= procedural_.octaves) return false;
    for (double& x : p_) x *= static_cast<double>(procedural_.lacunarity);
    waves_ *= procedural_.lacunarity;
    amplitude_ *= procedural_.gain;
    return true;
  }

 private:
  const ProceduralTexture& procedural_;
  std::array<double, 4> p_;
  float waves_;  // periods of this octave per footprint
  float amplitude_ = 1;
  std::int32_t octave_ = 0;
};

/// Sum of the octaves' noise over the sum of their amplitudes: in [-1, 1], mean 0.
float fbm(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint) {
  Octaves o(procedural, p, footprint);
  float sum = 0, amplitude_sum = 0;
  do {
    sum += o.amplitude() * o.visibility() * o.noise();
    amplitude_sum += o.amplitude();
  } while (o.next());
  return sum / amplitude_sum;
}

/// Sum of amplitude * |noise|: with gain 1/2 and lacunarity 2, Perlin's sum of |noise| / f.
struct Turbulence {
  float sum = 0, amplitude_sum = 0;
};
Turbulence turbulence(const ProceduralTexture& procedural, const std::array<double, 4>& p,
                      float footprint) {
  const float mean = kMeanAbsoluteNoise[static_cast<std::size_t>(procedural.dimensions)];
  Octaves o(procedural, p, footprint);
  Turbulence t;
  do {
    t.sum += o.amplitude() * (mean + o.visibility() * (std::fabs(o.noise()) - mean));
    t.amplitude_sum += o.amplitude();
  } while (o.next());
  return t;
}

/// Ridges where noise crosses zero; each octave is weighted by the previous one. Source: F. K.
/// Musgrave in "Texturing & Modeling: A Procedural Approach", 3rd edition, ch. 16.
float ridged(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint) {
  const float mean = kMeanRidgedNoise[static_cast<std::size_t>(procedural.dimensions)];
  Octaves o(procedural, p, footprint);
  float sum = 0, amplitude_sum = 0, weight = 1;
  do {
    const float ridge = 1 - std::fabs(o.noise());
    const float signal = weight * (mean + o.visibility() * (ridge * ridge - mean));
    sum += o.amplitude() * signal;
    amplitude_sum += o.amplitude();
    weight = clamp(2 * signal, 0.0f, 1.0f);
  } while (o.next());
  return sum / amplitude_sum;
}

/// A sine with one period per feature in [-1, 1], or its mean where it is too fine. Distortion
/// makes it finer locally, but not on average.
float wave(double x, float footprint) {
  const auto phase = static_cast<float>(x - std::floor(x));
  return visible_amplitude(footprint) * elementary::sin(kTwoPi * phase);
}

/// Layers across x, distorted by turbulence: sin(x + sum |noise| / f).
float marble(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint) {
  const float bend = procedural.distortion * turbulence(procedural, p, footprint).sum;
  return 0.5f + 0.5f * wave(p[0] + static_cast<double>(bend), footprint);
}

/// Rings about the y axis, distorted by fBm, with grain across them.
float wood(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint) {
  const double radius = std::sqrt(p[0] * p[0] + p[2] * p[2]);
  const float distortion = procedural.distortion * fbm(procedural, p, footprint);
  const float rings = 0.5f + 0.5f * wave(radius + static_cast<double>(distortion), footprint);
  constexpr double kFine = 24, kAlong = 0.5;
  ProceduralTexture grain = procedural;
  grain.octaves = 1;
  const std::array<double, 4> fine = {p[0] * kFine, p[1] * kAlong, p[2] * kFine, p[3]};
  const float fibres = fbm(grain, fine, footprint * static_cast<float>(kFine));
  return clamp(0.15f + 0.7f * rings + 0.15f * fibres, 0.0f, 1.0f);
}

float clouds(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint) {
  return smooth_step(-0.1f, 0.5f, fbm(procedural, p, footprint));
}

/// Worn patches of a coating, with scratches (noise stretched along x) at their edges.
float worn_metal(const ProceduralTexture& procedural, const std::array<double, 4>& p,
                 float footprint) {
  constexpr double kFine = 16, kAlong = 0.7;
  const std::array<double, 4> drawn = {p[0] * kAlong, p[1] * kFine, p[2] * kFine, p[3]};
  ProceduralTexture one = procedural;
  one.octaves = 1;
  const float scratches = fbm(one, drawn, footprint * static_cast<float>(kFine));
  const float patches = fbm(procedural, p, footprint);
  return smooth_step(-0.05f, 0.15f, patches + 0.12f * procedural.distortion * scratches);
}

/// Hot at y = 0, fading out at y = 1, with turbulence that rises over time.
float fire(const ProceduralTexture& procedural, const std::array<double, 4>& p, float footprint) {
  constexpr double kTongues = 3;  // across a flame's height
  const std::array<double, 4> rising = {p[0] * kTongues, p[1] * kTongues - 2 * p[3],
                                        p[2] * kTongues, p[3]};
  const Turbulence t = turbulence(procedural, rising, footprint * static_cast<float>(kTongues));
  const float mean =
      t.amplitude_sum * kMeanAbsoluteNoise[static_cast<std::size_t>(procedural.dimensions)];
  const auto height = static_cast<float>(clamp(p[1], -1e6, 1e6));
  return clamp(1 - height + procedural.distortion * height * (t.sum - mean) * 2, 0.0f, 1.0f);
}

}  // namespace

float pattern_at(const ProceduralTexture& procedural, const std::array<double, 4>& p,
                 float footprint) {
  using Pattern = ProceduralTexture::Pattern;
  switch (procedural.pattern) {
    case Pattern::noise:
      return 0.5f + 0.5f * visible_amplitude(footprint) *
                        gradient_noise(procedural.dimensions, p, procedural.seed);
    case Pattern::value_noise:
      return 0.5f + 0.5f * visible_amplitude(footprint) *
                        value_noise(procedural.dimensions, p, procedural.seed);
    case Pattern::fbm:
      return 0.5f + 0.5f * fbm(procedural, p, footprint);
    case Pattern::turbulence: {
      const Turbulence t = turbulence(procedural, p, footprint);
      return t.sum / t.amplitude_sum;
    }
    case Pattern::ridged:
      return ridged(procedural, p, footprint);
    case Pattern::marble:
      return marble(procedural, p, footprint);
    case Pattern::wood:
      return wood(procedural, p, footprint);
    case Pattern::clouds:
      return clouds(procedural, p, footprint);
    case Pattern::worn_metal:
      return worn_metal(procedural, p, footprint);
    case Pattern::fire:
      break;
  }
  return fire(procedural, p, footprint);
}

Vec4f ramp_at(const ProceduralTexture& procedural, float value) {
  const auto& ramp = procedural.ramp;
  if (!(value > ramp.front().at)) return ramp.front().color;
  for (std::size_t i = 1; i < ramp.size(); ++i) {
    if (!(value < ramp[i].at)) continue;
    const float f = (value - ramp[i - 1].at) / (ramp[i].at - ramp[i - 1].at);
    return ramp[i - 1].color + (ramp[i].color - ramp[i - 1].color) * f;
  }
  return ramp.back().color;
}

std::array<double, 4> in_features(const ProceduralTexture& procedural, const Vec3d& point) {
  const Vec3d p = point * Vec3d(procedural.scale) + Vec3d(procedural.offset);
  return {p.x, p.y, p.z, static_cast<double>(procedural.time)};
}

Vec4f procedural_color(const ProceduralTexture& procedural, const Vec3d& point, float footprint) {
  return ramp_at(procedural, pattern_at(procedural, in_features(procedural, point), footprint));
}

}  // namespace tessera::render
