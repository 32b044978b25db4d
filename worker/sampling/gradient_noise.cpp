#include "worker/sampling/gradient_noise.h"

#include <cmath>

#include "worker/sampling/hash.h"

namespace tessera::render {

namespace {

/// A point's position in its lattice cell.
template <int N>
struct Cell {
  std::array<std::int64_t, N> corner;  // the lowest
  std::array<float, N> from;           // offset from the corner, [0, 1]
  std::array<float, N> fade;           // 6 f^5 - 15 f^4 + 10 f^3 of the offset
};

/// Dot product of `d` and the gradient chosen by `hash`, scaled so that noise stays in [-1, 1]: it
/// is largest in the centre of a cell, where |d| is sqrt(N) / 2.
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

/// The gradient of the two-dimensional slope(), in double.
inline std::array<double, 2> gradient(std::uint64_t hash) {
  constexpr double kRoot2 = 1.4142135623730951;
  const auto which = static_cast<unsigned>(hash >> 61);
  const double x = (which & 1) != 0 ? -1 : 1, y = (which & 2) != 0 ? -1 : 1;
  if ((which & 4) != 0) return {x, y};
  if ((which & 1) == (which >> 1 & 1)) return {kRoot2 * x, 0};
  return {0, kRoot2 * y};
}

/// Dot product with an edge midpoint: one component is zero, the others are +-1.
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

/// Interpolates between the corners that share their first K coordinates, which `hash` includes.
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

NoiseSlope gradient_noise_slope(const std::array<double, 2>& p, std::uint32_t seed,
                                NoiseCell& last) {
  std::array<std::int64_t, 2> corner;
  // By axis: offset from the corner, the fade and its derivative.
  std::array<double, 2> from, fade, fade_slope;
  for (std::size_t k = 0; k < 2; ++k) {
    if (!(std::fabs(p[k]) < 0x1p51)) return {};
    const double low = std::floor(p[k]), f = p[k] - low;
    corner[k] = static_cast<std::int64_t>(low);
    from[k] = f;
    fade[k] = f * f * f * (f * (f * 6 - 15) + 10);
    fade_slope[k] = 30 * (f * f) * ((f - 1) * (f - 1));
  }
  if (last.corner[0] != corner[0] || last.corner[1] != corner[1]) {
    last.corner = corner;
    for (std::uint64_t k = 0; k < 4; ++k) {
      const std::uint64_t column = combine(seed, static_cast<std::uint64_t>(corner[0]) + k / 2);
      last.gradients[k] = gradient(combine(column, static_cast<std::uint64_t>(corner[1]) + k % 2));
    }
  }
  // The dot product of each corner's gradient and offset, interpolated along y, then along x.
  const auto& g = last.gradients;
  const double x0 = from[0], x1 = x0 - 1, y0 = from[1], y1 = y0 - 1;
  const double rise[4] = {g[0][0] * x0 + g[0][1] * y0, g[1][0] * x0 + g[1][1] * y1,
                          g[2][0] * x1 + g[2][1] * y0, g[3][0] * x1 + g[3][1] * y1};
  const auto blend = [&](std::size_t axis, double low, double high) {
    return low + fade[axis] * (high - low);
  };
  const double left = blend(1, rise[0], rise[1]), right = blend(1, rise[2], rise[3]);
  NoiseSlope out;
  out.value = blend(0, left, right);
  out.dx = fade_slope[0] * (right - left) +
           blend(0, blend(1, g[0][0], g[1][0]), blend(1, g[2][0], g[3][0]));
  out.dy = fade_slope[1] * blend(0, rise[1] - rise[0], rise[3] - rise[2]) +
           blend(0, blend(1, g[0][1], g[1][1]), blend(1, g[2][1], g[3][1]));
  return out;
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
