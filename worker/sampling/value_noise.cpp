#include "worker/sampling/value_noise.h"

#include <cmath>

#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

/// Weights of the four lattice points around a point at fraction f between the middle two.
std::array<float, 4> spline_weights(float f) {
  return {f * (-0.5f + f * (1 - 0.5f * f)), 1 + f * f * (1.5f * f - 2.5f),
          f * (0.5f + f * (2 - 1.5f * f)), f * f * (0.5f * f - 0.5f)};
}

/// In [-1, 1).
float random_number(std::uint64_t hash) {
  return static_cast<float>(hash >> 40) * 0x1p-23f - 1;
}

template <int N>
struct Neighbourhood {
  std::array<std::int64_t, N> corner;  // the lowest of four lattice points by axis
  std::array<std::array<float, 4>, N> weights;
};

/// Interpolates between the lattice points that share their first K coordinates, which `hash`
/// includes.
template <int N, int K>
float interpolate(const Neighbourhood<N>& around, std::uint64_t hash) {
  if constexpr (K == N) {
    return random_number(hash);
  } else {
    float sum = 0;
    for (std::uint64_t i = 0; i < 4; ++i) {
      const std::uint64_t point = static_cast<std::uint64_t>(around.corner[K]) + i;
      sum += around.weights[K][i] * interpolate<N, K + 1>(around, combine(hash, point));
    }
    return sum * (1 / kSplineOvershoot);
  }
}

template <int N>
float noise(const std::array<double, 4>& p, std::uint32_t seed) {
  Neighbourhood<N> around;
  for (std::size_t k = 0; k < N; ++k) {
    if (!(std::fabs(p[k]) < 0x1p51)) return 0;
    const double low = std::floor(p[k]);
    around.corner[k] = static_cast<std::int64_t>(low) - 1;
    around.weights[k] = spline_weights(static_cast<float>(p[k] - low));
  }
  return interpolate<N, 0>(around, seed);
}

}  // namespace

float value_noise(int dimensions, const std::array<double, 4>& p, std::uint32_t seed) {
  switch (dimensions) {
    case 1:
      return noise<1>(p, seed);
    case 2:
      return noise<2>(p, seed);
    case 3:
      return noise<3>(p, seed);
    default:
      return noise<4>(p, seed);
  }
}

}  // namespace tessera::render
