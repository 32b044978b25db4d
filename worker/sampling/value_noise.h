#pragma once

#include <array>
#include <cstdint>

namespace tessera::render {

/// Value noise in 1 to 4 dimensions: random numbers at the points of the integer lattice,
/// interpolated by Catmull-Rom splines, so it is continuously differentiable. In [-1, 1], with mean
/// 0. The numbers are hashes of the lattice point and the seed. Returns 0 for coordinates of 2^51
/// or more and for non-finite ones. Unlike gradient noise it is not 0 on the lattice, and large
/// blobs stand out where neighbouring numbers are alike. Sources: K. Perlin, "An image
/// synthesizer", 1985 (the idea); D. Peachey in "Texturing & Modeling: A Procedural Approach", 3rd
/// edition, ch. 2.
///
/// `p`: the first `dimensions` coordinates are used.
float value_noise(int dimensions, const std::array<double, 4>& p, std::uint32_t seed);

/// The largest sum of a spline's absolute weights, in one dimension: at the middle of a cell. Noise
/// is divided by its power, so that splines that overshoot remain in [-1, 1].
inline constexpr float kSplineOvershoot = 1.25f;

}  // namespace tessera::render
