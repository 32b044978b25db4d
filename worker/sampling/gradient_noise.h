#pragma once

#include <array>
#include <cstdint>

namespace tessera::render {

/// Gradient noise in 1 to 4 dimensions: zero at every point of the integer lattice, twice
/// continuously differentiable between, in [-1, 1], with mean 0 over its gradients. No tables: the
/// gradients are hashes of lattice point and seed, so no two seeds and no two places repeat. Points
/// 2^51 and farther from 0, and what is not finite, give 0.
///
/// Gradients are +-1 in one dimension, 8 unit vectors in two, the 12 and 32 middles of the cube's
/// and hypercube's edges in three and four. Source: K. Perlin, "Improving noise", 2002.
float gradient_noise(const std::array<double, 1>& p, std::uint32_t seed);
float gradient_noise(const std::array<double, 2>& p, std::uint32_t seed);
float gradient_noise(const std::array<double, 3>& p, std::uint32_t seed);
float gradient_noise(const std::array<double, 4>& p, std::uint32_t seed);

/// The same with the dimension, 1 to 4, as a number: the first `dimensions` of `p`.
float gradient_noise(int dimensions, const std::array<double, 4>& p, std::uint32_t seed);

/// Two-dimensional noise in double, and its slope.
struct NoiseSlope {
  double value = 0, dx = 0, dy = 0;
};
/// A square of the lattice with its corners' gradients: hashing them is most of the work, so who
/// asks for places close together keeps the last one, for one seed.
struct NoiseCell {
  std::array<std::int64_t, 2> corner = {INT64_MIN, INT64_MIN};  // the lower; none yet
  std::array<std::array<double, 2>, 4> gradients;
};
NoiseSlope gradient_noise_slope(const std::array<double, 2>& p, std::uint32_t seed,
                                NoiseCell& last);

/// Bounds the second derivative of two-dimensional noise in any direction. With the corners'
/// weights w, their offsets d and gradients of length sqrt(2), that in the unit direction u is at
/// most sqrt(2) times the sum over corners of |w_uu d + 2 w_u u|. Its maximum, 13.061 on a grid of
/// 1/400 and 1 degree, lies in the middle of smooth slopes, so that a grid finds all but 0.01 of
/// it.
inline constexpr double kNoiseCurvature = 13.1;

/// Mean over space of |noise| and of (1 - |noise|)^2, by dimension: what octaves too fine to be
/// seen are replaced by. Measured over 2^24 points; standard errors below 1e-4.
inline constexpr std::array<float, 5> kMeanAbsoluteNoise = {0, 0.3794f, 0.2489f, 0.2202f, 0.1586f};
inline constexpr std::array<float, 5> kMeanRidgedNoise = {0, 0.4786f, 0.5953f, 0.6325f, 0.7209f};

}  // namespace tessera::render
