#include "image/denoise/filter/spike_limit.h"

#include <cstddef>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

using P = FilterParameters;
constexpr std::ptrdiff_t kCountRadius = kSpikeMargin - 1;

/// R + G + B; 0 outside the frame.
Plane sums_of(const ColourPlanes& colour, const Plane& valid) {
  Plane sums(valid.size());
  for (std::size_t i = 0; i < sums.size(); ++i)
    sums[i] = ((colour[0][i] + colour[1][i]) + colour[2][i]) * valid[i];
  return sums;
}

/// The second largest among the neighbours of each pixel in both planes. Undefined in the outermost
/// rows and columns.
Plane second_largest(const Plane& a, const Plane& b, std::ptrdiff_t stride) {
  const std::size_t begin = static_cast<std::size_t>(stride) + 1, end = a.size() - begin;
  Plane largest(a.size()), second(a.size());
  for (const Plane* plane : {&a, &b}) {
    for (const std::ptrdiff_t offset : {-stride - 1, -stride, -stride + 1, std::ptrdiff_t{-1},
                                        std::ptrdiff_t{1}, stride - 1, stride, stride + 1}) {
      const float* values = plane->data() + offset;
      for (std::size_t i = begin; i < end; ++i) {
        const float value = values[i], before = largest[i];
        const float less = value < before ? value : before;
        largest[i] = value < before ? before : value;
        second[i] = second[i] < less ? less : second[i];
      }
    }
  }
  return second;
}

/// Factors that limit the spikes of a stream; 1 for other pixels.
Plane factors_of(const Plane& own, const Plane& other, const Plane& second) {
  Plane factors(own.size());
  for (std::size_t i = 0; i < own.size(); ++i) {
    const float limit = other[i] < second[i] ? second[i] : other[i];
    factors[i] = own[i] > P::kSpikeFactor * limit ? limit / own[i] : 1.0f;
  }
  return factors;
}

/// Sums of the 2 kCountRadius + 1 values around each one, `step` apart; 0 near the ends.
Plane sums_along(const Plane& values, std::ptrdiff_t step) {
  Plane sums(values.size());
  const auto reach = static_cast<std::size_t>(kCountRadius * step);
  for (std::ptrdiff_t k = -kCountRadius; k <= kCountRadius; ++k) {
    const float* from = values.data() + k * step;
    for (std::size_t i = reach; i < sums.size() - reach; ++i) sums[i] += from[i];
  }
  return sums;
}

/// Number of spikes of both streams within kCountRadius of each pixel.
Plane counts_of(const Plane& factors_a, const Plane& factors_b, std::ptrdiff_t stride) {
  Plane spikes(factors_a.size());
  for (std::size_t i = 0; i < spikes.size(); ++i)
    spikes[i] = (factors_a[i] < 1 ? 1.0f : 0.0f) + (factors_b[i] < 1 ? 1.0f : 0.0f);
  return sums_along(sums_along(spikes, 1), stride);
}

}  // namespace

void limit_spikes(const Plane& valid, std::int32_t width, StreamPair& streams) {
  const std::ptrdiff_t stride = width;
  const Plane a = sums_of(streams.a, valid), b = sums_of(streams.b, valid);
  const Plane second = second_largest(a, b, stride);
  const Plane factors_a = factors_of(a, b, second), factors_b = factors_of(b, a, second);
  const Plane counts = counts_of(factors_a, factors_b, stride);
  const std::ptrdiff_t height = std::ssize(valid) / stride;
  for (std::ptrdiff_t y = kSpikeMargin; y < height - kSpikeMargin; ++y) {
    const auto first = static_cast<std::size_t>(y * stride + kSpikeMargin);
    const std::size_t last =
        first + static_cast<std::size_t>(stride - std::ptrdiff_t{2} * kSpikeMargin);
    for (std::size_t i = first; i < last; ++i) {
      if (counts[i] == 0 || counts[i] > P::kMaxSpikes) continue;
      for (std::size_t c = 0; c < 3; ++c) {
        streams.a[c][i] *= factors_a[i];
        streams.b[c][i] *= factors_b[i];
      }
    }
  }
}

}  // namespace tessera::image
