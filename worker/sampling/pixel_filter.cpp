#include "worker/sampling/pixel_filter.h"

#include <vector>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 0x1.921fb54442d18p+1;
constexpr int kSteps = 1024, kMiddle = kSteps / 2;

/// The filter over its support, x in [-1/2, 1/2], up to a constant factor.
double value(contract::PixelFilter filter, double x) {
  if (filter == contract::PixelFilter::gaussian) return elementary::exp(-18 * x * x);
  // F. Harris, "On the use of windows for harmonic analysis", 1978: 4 terms, -92 dB.
  const double phase = 2 * kPi * (x + 0.5);
  return 0.35875 - 0.48829 * elementary::cos(phase) + 0.14128 * elementary::cos(2 * phase) -
         0.01168 * elementary::cos(3 * phase);
}

}  // namespace

PixelFilterSampler::PixelFilterSampler(contract::PixelFilter filter, double width)
    : width_(static_cast<float>(width)) {
  if (filter == contract::PixelFilter::box) return;
  std::vector<double> weights(kSteps);
  for (int i = 0; i < kSteps; ++i) {
    weights[static_cast<std::size_t>(i)] = value(filter, (i + 0.5) / kSteps - 0.5);
  }
  steps_ = DiscreteDistribution(weights);
}

float PixelFilterSampler::invert(float u) const {
  if (steps_.empty()) return u - 0.5f;
  const DiscreteDistribution::Choice step = steps_.sample(static_cast<double>(u));
  // A multiple of 2^-10 plus a fraction of 2^-10; only the last sum rounds.
  const float x = (static_cast<float>(step.index - kMiddle) + step.remapped) / kSteps;
  constexpr float kBelowHalf = 0x1.fffffep-2f;
  return x < kBelowHalf ? x : kBelowHalf;
}

float PixelFilterSampler::density(float offset) const {
  const float x = offset / width_;
  if (!(x >= -0.5f) || !(x < 0.5f)) return 0;
  if (steps_.empty()) return 1 / width_;
  const auto step = static_cast<std::int32_t>((x + 0.5f) * kSteps);
  return steps_.probability(step) * kSteps / width_;
}

Vec2f PixelFilterSampler::sample(Vec2f u) const {
  const float x = invert(u.x);
  const float y = invert(u.y);
  return {x * width_, y * width_};
}

}  // namespace tessera::render
