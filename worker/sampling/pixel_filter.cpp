#include "worker/sampling/pixel_filter.h"

#include <cstddef>
#include <cstdint>

#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 0x1.921fb54442d18p+1;
constexpr int kQuantiles = 1024;     // linear between them
constexpr int kIntegration = 65536;  // midpoint rule

/// The filter over its support, x in [-1/2, 1/2]; any scale.
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
  const double step = 1.0 / kIntegration;
  std::vector<double> cdf = {0};
  cdf.reserve(kIntegration + 1);
  for (int i = 0; i < kIntegration; ++i) {
    cdf.push_back(cdf.back() + value(filter, -0.5 + (i + 0.5) * step));
  }
  edges_.resize(kQuantiles + 1);
  std::size_t cell = 0;
  for (int q = 0; q <= kQuantiles; ++q) {
    const double wanted = cdf.back() * q / kQuantiles;
    while (cell + 1 < kIntegration && cdf[cell + 1] < wanted) ++cell;
    const double inside = (wanted - cdf[cell]) / (cdf[cell + 1] - cdf[cell]);
    const double x = -0.5 + (static_cast<double>(cell) + inside) * step;
    edges_[static_cast<std::size_t>(q)] = static_cast<float>(clamp(x, -0.5, 0.5));
  }
}

float PixelFilterSampler::invert(float u) const {
  if (edges_.empty()) return u - 0.5f;
  const float scaled = u * kQuantiles;
  const auto cell = static_cast<std::size_t>(
      static_cast<std::int32_t>(clamp(scaled, 0.0f, static_cast<float>(kQuantiles - 1))));
  return lerp(edges_[cell], edges_[cell + 1], scaled - static_cast<float>(cell));
}

Vec2f PixelFilterSampler::sample(Vec2f u) const {
  const float x = invert(u.x);
  const float y = invert(u.y);
  return {x * width_, y * width_};
}

}  // namespace tessera::render
