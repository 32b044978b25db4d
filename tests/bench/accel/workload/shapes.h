#pragma once

#include <cstdint>
#include <functional>

#include "worker/scene/scene.h"

namespace tessera::render::bench {

/// Pseudo-random numbers that depend on the seed only, not on the machine.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15u + 1) {}
  /// Uniform in [0, 1).
  float unit();
  /// Uniform in [-1, 1).
  float both() { return 2 * unit() - 1; }
  /// Uniform on the unit sphere.
  Vec3f direction();

 private:
  std::uint64_t state_;
};

/// Sums octaves of smooth noise, each with half the amplitude and twice the frequency of the one
/// before. The result is in [-1, 1].
float fractal_noise(const Vec3f& p, int octaves);

/// Generates a grid of (rows + 1) x (columns + 1) points of `surface`, whose arguments are in [0,
/// 1], with two triangles per cell.
Primitive grid(std::uint32_t rows, std::uint32_t columns,
               const std::function<Vec3f(double, double)>& surface);

/// Adds a parallelepiped, given by a corner and three edges: 12 triangles.
void add_box(Primitive& p, const Vec3f& corner, const Vec3f& a, const Vec3f& b, const Vec3f& c);

/// Adds a rectangle, given by a corner and two edges: two triangles.
void add_quad(Primitive& p, const Vec3f& corner, const Vec3f& a, const Vec3f& b);

void add_triangle(Primitive& p, const Vec3f& a, const Vec3f& b, const Vec3f& c);

/// Completes a unit vector n to a right-handed orthonormal frame.
void make_frame(const Vec3f& n, Vec3f& a, Vec3f& b);

}  // namespace tessera::render::bench
