#pragma once

#include <array>
#include <cstdint>

namespace tessera::render {

/// Gradient noise in 1 to 4 dimensions: zero at every point of the integer lattice, twice
/// continuously differentiable, in [-1, 1], with mean 0 over its gradients. Gradients are hashes of
/// the lattice point and the seed instead of table entries, so the noise does not repeat. Returns 0
/// for coordinates of 2^51 or more and for non-finite ones.
///
/// The gradients are +-1 in one dimension, 8 unit vectors in two, and the 12 and 32 midpoints of
/// the edges of the cube and the hypercube in three and four. Source: K. Perlin, "Improving noise",
/// 2002.
float gradient_noise(const std::array<double, 1>& p, std::uint32_t seed);
float gradient_noise(const std::array<double, 2>& p, std::uint32_t seed);
float gradient_noise(const std::array<double, 3>& p, std::uint32_t seed);
float gradient_noise(const std::array<double, 4>& p, std::uint32_t seed);

/// The same for the first `dimensions` coordinates of `p`, 1 to 4.
float gradient_noise(int dimensions, const std::array<double, 4>& p, std::uint32_t seed);

/// Two-dimensional noise in double and its derivatives.
struct NoiseSlope {
  double value = 0, dx = 0, dy = 0;
};
/// Cache of the gradients at the corners of one lattice cell, for one seed: hashing them is most of
/// the work, and successive points tend to be in the same cell.
struct NoiseCell {
  std::array<std::int64_t, 2> corner = {INT64_MIN, INT64_MIN};  // the lowest; initially none
  std::array<std::array<double, 2>, 4> gradients;
};
NoiseSlope gradient_noise_slope(const std::array<double, 2>& p, std::uint32_t seed,
                                NoiseCell& last);

/// Bound of the second derivative of two-dimensional noise in any direction. For the corners'
/// weights w, their offsets d and gradients of length sqrt(2), the derivative in the unit direction
/// u is at most sqrt(2) times the sum over corners of |w_uu d + 2 w_u u|. The maximum of this sum
/// on a grid of 1/400 and 1 degree is 13.061; it is smooth there, so the grid misses at most 0.01.
inline constexpr double kNoiseCurvature = 13.1;

/// Mean over space of |noise| and of (1 - |noise|)^2, by dimension. They replace octaves that are
/// too fine to be resolved. Measured over 2^24 points; standard errors below 1e-4.
inline constexpr std::array<float, 5> kMeanAbsoluteNoise = {0, 0.3794f, 0.2489f, 0.2202f, 0.1586f};
inline constexpr std::array<float, 5> kMeanRidgedNoise = {0, 0.4786f, 0.5953f, 0.6325f, 0.7209f};

}  // namespace tessera::render
