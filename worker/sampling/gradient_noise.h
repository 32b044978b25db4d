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

/// Mean over space of |noise| and of (1 - |noise|)^2, by dimension: what octaves too fine to be
/// seen are replaced by. Measured over 2^24 points; standard errors below 1e-4.
inline constexpr std::array<float, 5> kMeanAbsoluteNoise = {0, 0.3794f, 0.2489f, 0.2202f, 0.1586f};
inline constexpr std::array<float, 5> kMeanRidgedNoise = {0, 0.4786f, 0.5953f, 0.6325f, 0.7209f};

}  // namespace tessera::render
