#include "worker/sampling/gradient_noise.h"

#include <cmath>

#include "worker/sampling/hash.h"

namespace tessera::render {

namespace {

/// Where a point lies in its cell of the lattice.
template <int N>
struct Cell {
  std::array<std::int64_t, N> corner;  // the lowest
  std::array<float, N> from;           // the point, from there: [0, 1]
  std::array<float, N> fade;           // 6 f^5 - 15 f^4 + 10 f^3 of that
};

/// Dot product of the gradient that `hash` chooses with `d`, scaled so that noise stays in [-1, 1]:
/// in the middle of a cell, where it is largest, |d| is sqrt(N) / 2.
inline float slope(std::uint64_t hash, const std::array<float, 1>& d) {
  return (hash >> 63) != 0 ? -2 * d[0] : 2 * d[0];
}

inline float slope(std::uint64_t hash, const std::array<float, 2>& d) {
  constexpr float kRoot2 = 1.41421356f;
  const auto which = static_cast<unsigned>(hash >> 61);
  const float x = (which & 1) != 0 ? -d[0] : d[0], y = (which & 2) != 0 ? -d[1] : d[1];
  if ((which & 4) != 0) return x + y;                         // (+-1, +-1) / sqrt(2), times sqrt(2)
  return kRoot2 * ((which & 1) == (which >> 1 & 1) ? x : y);  // both signs of both axes
}

/// One axis left out, any signs on the others.
template <int N>
inline float edge_slope(unsigned left_out, unsigned signs, const std::array<float, N>& d) {
  float sum = 0;
  for (unsigned k = 0, bit = 0; k < N; ++k) {
    if (k == left_out) continue;
    sum += (signs >> bit++ & 1) != 0 ? -d[k] : d[k];
  }
  return sum;
}

inline float slope(std::uint64_t hash, const std::array<float, 3>& d) {
  const auto which = static_cast<unsigned>((hash >> 32) * 12 >> 32);
  return edge_slope<3>(which >> 2, which & 3, d);
}

inline float slope(std::uint64_t hash, const std::array<float, 4>& d) {
  const auto which = static_cast<unsigned>(hash >> 59);
  return edge_slope<4>(which >> 3, which & 7, d) * (2.0f / 3);
}

/// Blends the corners that agree in the first K coordinates, folded into `hash`.
template <int N, int K>
inline float blend(const Cell<N>& cell, std::uint64_t hash, std::array<float, N>& from) {
  if constexpr (K == N) {
    return slope(hash, from);
  } else {
    const auto corner = static_cast<std::uint64_t>(cell.corner[K]);
    from[K] = cell.from[K];
    const float low = blend<N, K + 1>(cell, combine(hash, corner), from);
    from[K] = cell.from[K] - 1;
    const float high = blend<N, K + 1>(cell, combine(hash, corner + 1), from);
    return low + cell.fade[K] * (high - low);
  }
}

template <int N>
inline float noise(const std::array<double, N>& p, std::uint32_t seed) {
  Cell<N> cell;
  for (std::size_t k = 0; k < N; ++k) {
    if (!(std::fabs(p[k]) < 0x1p51)) return 0;
    const double low = std::floor(p[k]);
    cell.corner[k] = static_cast<std::int64_t>(low);
    const auto f = static_cast<float>(p[k] - low);
    cell.from[k] = f;
    cell.fade[k] = f * f * f * (f * (f * 6 - 15) + 10);
  }
  std::array<float, N> from;
  return blend<N, 0>(cell, seed, from);
}

}  // namespace

float gradient_noise(const std::array<double, 1>& p, std::uint32_t seed) {
  return noise<1>(p, seed);
}
float gradient_noise(const std::array<double, 2>& p, std::uint32_t seed) {
  return noise<2>(p, seed);
}
float gradient_noise(const std::array<double, 3>& p, std::uint32_t seed) {
  return noise<3>(p, seed);
}
float gradient_noise(const std::array<double, 4>& p, std::uint32_t seed) {
  return noise<4>(p, seed);
}

float gradient_noise(int dimensions, const std::array<double, 4>& p, std::uint32_t seed) {
  switch (dimensions) {
    case 1:
      return noise<1>({p[0]}, seed);
    case 2:
      return noise<2>({p[0], p[1]}, seed);
    case 3:
      return noise<3>({p[0], p[1], p[2]}, seed);
    default:
      return noise<4>(p, seed);
  }
}

}  // namespace tessera::render
