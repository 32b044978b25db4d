#include "worker/shading/surface/procedural_texture.h"

#include <cmath>

#include "worker/math/elementary.h"
#include "worker/sampling/gradient_noise.h"

namespace tessera::render {

namespace {

constexpr float kTwoPi = 6.28318531f;

/// Share of a wave that is seen, with `frequency` features and thus waves a spot: all up to half a
/// wave, which samples can resolve, none from one on.
float seen_share(float waves) {
  return clamp(2 - 2 * waves, 0.0f, 1.0f);
}

float smooth_step(float low, float high, float x) {
  const float f = clamp((x - low) / (high - low), 0.0f, 1.0f);
  return f * f * (3 - 2 * f);
}

/// Noise of one octave after another: frequency times lacunarity, amplitude times gain.
class Octaves {
 public:
  Octaves(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint)
      : procedure_(procedure), p_(p), waves_(footprint) {}

  float amplitude() const { return amplitude_; }
  float seen() const { return seen_share(waves_); }

  /// Of this octave; 0 where none of it is seen.
  float noise() const {
    if (!(waves_ < 1)) return 0;
    return gradient_noise(procedure_.dimensions, p_,
                          procedure_.seed + static_cast<std::uint32_t>(octave_));
  }

  bool next() {
    if (++octave_ >= procedure_.octaves) return false;
    for (double& x : p_) x *= static_cast<double>(procedure_.lacunarity);
    waves_ *= procedure_.lacunarity;
    amplitude_ *= procedure_.gain;
    return true;
  }

 private:
  const ProceduralTexture& procedure_;
  std::array<double, 4> p_;
  float waves_;  // of this octave a spot
  float amplitude_ = 1;
  std::int32_t octave_ = 0;
};

/// Sum of the octaves' noise over the sum of their amplitudes: [-1, 1], mean 0.
float fbm(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  Octaves o(procedure, p, footprint);
  float sum = 0, most = 0;
  do {
    sum += o.amplitude() * o.seen() * o.noise();
    most += o.amplitude();
  } while (o.next());
  return sum / most;
}

/// Sum of amplitude times |noise|: with gain 1/2 and lacunarity 2, Perlin's sum of |noise| / f.
struct Turbulence {
  float sum = 0, most = 0;
};
Turbulence turbulence(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  const float mean = kMeanAbsoluteNoise[static_cast<std::size_t>(procedure.dimensions)];
  Octaves o(procedure, p, footprint);
  Turbulence t;
  do {
    t.sum += o.amplitude() * (mean + o.seen() * (std::fabs(o.noise()) - mean));
    t.most += o.amplitude();
  } while (o.next());
  return t;
}

/// Ridges where noise crosses zero, each octave strongest where the one before has its ridges.
/// Source: F. K. Musgrave in "Texturing & Modeling: A Procedural Approach", 3rd edition, ch. 16.
float ridged(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  const float mean = kMeanRidgedNoise[static_cast<std::size_t>(procedure.dimensions)];
  Octaves o(procedure, p, footprint);
  float sum = 0, most = 0, weight = 1;
  do {
    const float ridge = 1 - std::fabs(o.noise());
    const float signal = weight * (mean + o.seen() * (ridge * ridge - mean));
    sum += o.amplitude() * signal;
    most += o.amplitude();
    weight = clamp(2 * signal, 0.0f, 1.0f);
  } while (o.next());
  return sum / most;
}

/// A sine of one wave a feature, its mean where it is too fine; [-1, 1]. The distortion by
/// turbulence makes it locally finer, but not on average.
float wave(double x, float footprint) {
  const auto phase = static_cast<float>(x - std::floor(x));
  return seen_share(footprint) * elementary::sin(kTwoPi * phase);
}

/// Layers across x, distorted: sin(x + sum |noise| / f).
float marble(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  const float bend = procedure.distortion * turbulence(procedure, p, footprint).sum;
  return 0.5f + 0.5f * wave(p[0] + static_cast<double>(bend), footprint);
}

/// Rings about the y axis, uneven by fBm, with a grain across them.
float wood(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  const double radius = std::sqrt(p[0] * p[0] + p[2] * p[2]);
  const float uneven = procedure.distortion * fbm(procedure, p, footprint);
  const float rings = 0.5f + 0.5f * wave(radius + static_cast<double>(uneven), footprint);
  constexpr double kFine = 24, kAlong = 0.5;
  ProceduralTexture grain = procedure;
  grain.octaves = 1;
  const std::array<double, 4> fine = {p[0] * kFine, p[1] * kAlong, p[2] * kFine, p[3]};
  const float fibres = fbm(grain, fine, footprint * static_cast<float>(kFine));
  return clamp(0.15f + 0.7f * rings + 0.15f * fibres, 0.0f, 1.0f);
}

float clouds(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  return smooth_step(-0.1f, 0.5f, fbm(procedure, p, footprint));
}

/// Patches where the coat is gone, with scratches (noise drawn out along x) at their rims.
float worn_metal(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  constexpr double kFine = 16, kAlong = 0.7;
  const std::array<double, 4> drawn = {p[0] * kAlong, p[1] * kFine, p[2] * kFine, p[3]};
  ProceduralTexture one = procedure;
  one.octaves = 1;
  const float scratches = fbm(one, drawn, footprint * static_cast<float>(kFine));
  const float patches = fbm(procedure, p, footprint);
  return smooth_step(-0.05f, 0.15f, patches + 0.12f * procedure.distortion * scratches);
}

/// Hot at y = 0, out at y = 1, torn by turbulence that rises as time goes on.
float fire(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  constexpr double kTongues = 3;  // across a flame's height
  const std::array<double, 4> rising = {p[0] * kTongues, p[1] * kTongues - 2 * p[3],
                                        p[2] * kTongues, p[3]};
  const Turbulence t = turbulence(procedure, rising, footprint * static_cast<float>(kTongues));
  const float mean = t.most * kMeanAbsoluteNoise[static_cast<std::size_t>(procedure.dimensions)];
  const auto height = static_cast<float>(clamp(p[1], -1e6, 1e6));
  return clamp(1 - height + procedure.distortion * height * (t.sum - mean) * 2, 0.0f, 1.0f);
}

}  // namespace

float pattern_at(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint) {
  using Pattern = ProceduralTexture::Pattern;
  switch (procedure.pattern) {
    case Pattern::noise:
      return 0.5f +
             0.5f * seen_share(footprint) * gradient_noise(procedure.dimensions, p, procedure.seed);
    case Pattern::fbm:
      return 0.5f + 0.5f * fbm(procedure, p, footprint);
    case Pattern::turbulence: {
      const Turbulence t = turbulence(procedure, p, footprint);
      return t.sum / t.most;
    }
    case Pattern::ridged:
      return ridged(procedure, p, footprint);
    case Pattern::marble:
      return marble(procedure, p, footprint);
    case Pattern::wood:
      return wood(procedure, p, footprint);
    case Pattern::clouds:
      return clouds(procedure, p, footprint);
    case Pattern::worn_metal:
      return worn_metal(procedure, p, footprint);
    case Pattern::fire:
      break;
  }
  return fire(procedure, p, footprint);
}

Vec4f ramp_at(const ProceduralTexture& procedure, float value) {
  const auto& ramp = procedure.ramp;
  if (!(value > ramp.front().at)) return ramp.front().color;
  for (std::size_t i = 1; i < ramp.size(); ++i) {
    if (!(value < ramp[i].at)) continue;
    const float f = (value - ramp[i - 1].at) / (ramp[i].at - ramp[i - 1].at);
    return ramp[i - 1].color + (ramp[i].color - ramp[i - 1].color) * f;
  }
  return ramp.back().color;
}

std::array<double, 4> in_features(const ProceduralTexture& f, const Vec3d& point) {
  const Vec3d p = point * Vec3d(f.scale) + Vec3d(f.offset);
  return {p.x, p.y, p.z, static_cast<double>(f.time)};
}

Vec4f procedure_color(const ProceduralTexture& procedure, const Vec3d& point, float footprint) {
  return ramp_at(procedure, pattern_at(procedure, in_features(procedure, point), footprint));
}

}  // namespace tessera::render
