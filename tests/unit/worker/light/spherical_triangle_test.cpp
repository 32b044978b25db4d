#include "worker/light/emitters/spherical_triangle.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "worker/sampling/sampler.h"

namespace tessera::render {
namespace {

using Corners = std::array<Vec3d, 3>;

SphericalTriangle seen_triangle(const Corners& t) {
  return SphericalTriangle::seen_from_origin(t[0], t[1], t[2]);
}

/// Both halves of the square of side 1 about the axis, at height z.
std::array<Corners, 2> unit_square(double z) {
  const Vec3d a = {-0.5, z, -0.5}, b = {0.5, z, -0.5}, c = {0.5, z, 0.5}, d = {-0.5, z, 0.5};
  return {Corners{a, b, c}, Corners{a, c, d}};
}

TEST(SphericalTriangle, SolidAngleMatchesFormula) {
  EXPECT_NEAR(seen_triangle({Vec3d{1, 0, 0}, {0, 2, 0}, {0, 0, 3}}).solid_angle,
              std::numbers::pi / 2, 1e-14);
  for (const double z : {1e3, 1.0, 0.1, 0.01, 1e-3, 1e-6}) {
    const double expected = 4 * std::atan(1 / (2 * z * std::sqrt(4 * z * z + 2)));
    const auto square = unit_square(z);
    const double sum = seen_triangle(square[0]).solid_angle + seen_triangle(square[1]).solid_angle;
    // Close to the square its diagonal passes overhead, where 1 is subtracted from 1 and divided by
    // the height.
    EXPECT_NEAR(sum / expected, 1, 1e-13 + 0x1p-52 / z) << z;
  }
}

TEST(SphericalTriangle, SmallSizesKeepPrecision) {  // hard case 59, for triangles
  for (const double size : {1e-2, 1e-4, 1e-6}) {
    // Facing the viewer at distance 1: area / d^2, except for terms of second order in the size.
    const Corners t = {Vec3d{0, 0, 1}, {size, 0, 1}, {0, size, 1}};
    EXPECT_NEAR(seen_triangle(t).solid_angle / (0.5 * size * size), 1, size * size + 1e-9) << size;
  }
}

TEST(SphericalTriangle, ViewInPlaneHasNoSolidAngle) {
  EXPECT_EQ(seen_triangle({Vec3d{1, 0, 0}, {2, 0, 0}, {3, 0, 0}}).solid_angle, 0);
  EXPECT_EQ(seen_triangle({Vec3d{1, 0, 0}, {0, 1, 0}, {3, 2, 0}}).solid_angle, 0);
  EXPECT_EQ(seen_triangle({Vec3d{0, 0, 0}, {0, 1, 0}, {3, 2, 1}}).solid_angle, 0);
}

/// The parts of `t` after splitting every triangle into four `times` times.
std::vector<Corners> cut(const Corners& t, int times) {
  if (times == 0) return {t};
  const Vec3d ab = (t[0] + t[1]) * 0.5, bc = (t[1] + t[2]) * 0.5, ca = (t[2] + t[0]) * 0.5;
  std::vector<Corners> all;
  for (const Corners& part :
       {Corners{t[0], ab, ca}, Corners{ab, t[1], bc}, Corners{ca, bc, t[2]}, Corners{ab, bc, ca}}) {
    for (const Corners& piece : cut(part, times - 1)) all.push_back(piece);
  }
  return all;
}

/// Returns whether the ray along `d` from the origin hits `t`.
bool meets(const Corners& t, const Vec3d& d) {
  const double x = dot(d, cross(t[0], t[1])), y = dot(d, cross(t[1], t[2])),
               z = dot(d, cross(t[2], t[0]));
  return (x >= 0 && y >= 0 && z >= 0) || (x <= 0 && y <= 0 && z <= 0);
}

/// Triangles near and far, wide, thin and reversed.
std::vector<Corners> triangles() {
  return {unit_square(1)[0],
          unit_square(0.1)[0],
          unit_square(0.01)[1],
          {Vec3d{1, 0, 0}, {0, 0, 1}, {0, 1, 0}},
          {Vec3d{5, 0.2, 0}, {5, 0, 0.2}, {5, 0, 0}},
          {Vec3d{1, 1, 1}, {1, 1.01, 4}, {0.9, 1, 1}}};
}

TEST(SphericalTriangle, SamplesAreUniformOverSolidAngle) {
  constexpr int kSamples = 64'000;
  for (const Corners& t : triangles()) {
    const SphericalTriangle triangle = seen_triangle(t);
    ASSERT_TRUE(triangle.is_near());
    const std::vector<Corners> parts = cut(t, 2);
    std::vector<int> counts(parts.size());
    for (int i = 0; i < kSamples; ++i) {
      const Vec4d u = Sampler(1, 0, i, 0, 0).get_4d_fine(0);
      const Vec3d d = triangle.sample(u.x, u.y);
      ASSERT_NEAR(dot(d, d), 1, 1e-12);
      for (std::size_t k = 0; k < parts.size(); ++k) counts[k] += meets(parts[k], d) ? 1 : 0;
    }
    double chi = 0;
    int total = 0;
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const double expected = kSamples * seen_triangle(parts[k]).solid_angle / triangle.solid_angle;
      chi += (counts[k] - expected) * (counts[k] - expected) / expected;
      total += counts[k];
    }
    EXPECT_NEAR(total, kSamples, kSamples * 1e-3);  // none outside; edges may count twice
    // 15 degrees of freedom: 44 is exceeded once in 10,000 times.
    EXPECT_LT(chi, 44);
  }
}

TEST(SphericalTriangle, ExtremeRandomNumbersAreSafe) {  // hard case 63
  for (const Corners& t : triangles()) {
    const SphericalTriangle triangle = seen_triangle(t);
    for (const double u1 : {0.0, 0x1p-53, 0.5, 1 - 0x1p-53}) {
      for (const double u2 : {0.0, 0x1p-53, 0.5, 1 - 0x1p-53}) {
        const Vec3d d = triangle.sample(u1, u2);
        ASSERT_NEAR(dot(d, d), 1, 1e-12) << u1 << ' ' << u2;
        const Vec2f w = triangle.barycentrics_at(d);
        ASSERT_TRUE(w.x >= 0 && w.y >= 0 && w.x + w.y <= 1 + 1e-6f) << u1 << ' ' << u2;
      }
    }
  }
}

TEST(SphericalTriangle, PointsMatchDirections) {
  for (const Corners& t : triangles()) {
    const SphericalTriangle triangle = seen_triangle(t);
    for (int i = 0; i < 1000; ++i) {
      const Vec4d u = Sampler(2, 0, i, 0, 0).get_4d_fine(0);
      const Vec3d d = triangle.sample(u.x, u.y);
      const Vec2f w = triangle.barycentrics_at(d);
      const Vec3d p = t[0] + (t[1] - t[0]) * static_cast<double>(w.x) +
                      (t[2] - t[0]) * static_cast<double>(w.y);
      // Barycentrics are floats: half an ulp of 1 times the longest edge for each.
      const double edge = length(t[1] - t[0]) + length(t[2] - t[0]);
      ASSERT_LT(length(cross(p, d)), 0x1p-24 * edge + 1e-12);
    }
  }
}

TEST(SphericalTriangle, SquareFormFactorMatchesFormula) {  // hard case 58
  const double expected[] = {0.239456, 0.968340, 0.999673};
  const double heights[] = {1, 0.1, 0.01};
  constexpr int kSide = 64;
  for (int i = 0; i < 3; ++i) {
    double sum = 0;
    for (const Corners& t : unit_square(heights[i])) {
      const SphericalTriangle triangle = seen_triangle(t);
      for (int k = 0; k < kSide * kSide; ++k) {
        const int row = k / kSide, column = k % kSide;
        const Vec3d d = triangle.sample((column + 0.5) / kSide, (row + 0.5) / kSide);
        sum += d.y * triangle.solid_angle / std::numbers::pi / (kSide * kSide);
      }
    }
    EXPECT_NEAR(sum, expected[i], 1e-3) << heights[i];
  }
}

}  // namespace
}  // namespace tessera::render
