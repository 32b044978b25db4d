#include "worker/light/emitters/spherical_rectangle.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "worker/light/emitters/spherical_triangle.h"
#include "worker/sampling/sampler.h"

namespace tessera::render {
namespace {

struct Sides {
  Vec3d corner, along_s, along_t;

  Vec3d at(double s, double t) const { return corner + along_s * s + along_t * t; }
};

SphericalRectangle seen_rectangle(const Sides& r) {
  return {r.corner, r.along_s, r.along_t};
}

/// Rectangles overhead, to the side, thin, close, rotated, and seen from behind.
std::vector<Sides> rectangles() {
  return {{{-0.5, -0.5, 1}, {1, 0, 0}, {0, 1, 0}}, {{-0.5, -0.5, 0.01}, {1, 0, 0}, {0, 1, 0}},
          {{2, 3, 1}, {1, 0, 0}, {0, 2, 0}},       {{-3, 1, 0.5}, {5, 0, 0}, {0, 0.05, 0}},
          {{0, 0, -1}, {0, 1, 0}, {1, 0, 0}},      {{1, 1, 1}, {0.6, 0.8, 0}, {-0.48, 0.36, 0.8}}};
}

TEST(SphericalRectangle, SolidAngleIsSumOfHalves) {
  for (const Sides& r : rectangles()) {
    const Vec3d a = r.at(0, 0), b = r.at(1, 0), c = r.at(1, 1), d = r.at(0, 1);
    const double halves = SphericalTriangle::seen_from_origin(a, b, c).solid_angle +
                          SphericalTriangle::seen_from_origin(a, c, d).solid_angle;
    EXPECT_NEAR(seen_rectangle(r).solid_angle() / halves, 1, 1e-12);
  }
}

TEST(SphericalRectangle, SmallSizesKeepPrecision) {  // hard case 59, for rectangles
  for (const double size : {1e-2, 1e-4, 1e-6}) {
    // Products of numbers near 1 keep an angle of size^2 up to 2^-50.
    const Sides r = {{-size / 2, -size / 2, 1}, {size, 0, 0}, {0, size, 0}};
    EXPECT_NEAR(seen_rectangle(r).solid_angle() / (size * size), 1,
                size * size + 0x1p-50 / (size * size));
  }
}

TEST(SphericalRectangle, ViewInPlaneHasNoSolidAngle) {
  EXPECT_EQ(seen_rectangle({{1, 1, 0}, {1, 0, 0}, {0, 1, 0}}).solid_angle(), 0);
  EXPECT_EQ(seen_rectangle({{-1, -1, 0}, {2, 0, 0}, {0, 2, 0}}).solid_angle(), 0);
}

TEST(SphericalRectangle, SamplesAreUniformOverSolidAngle) {
  constexpr int kSamples = 64'000, kCells = 4;
  for (const Sides& r : rectangles()) {
    const SphericalRectangle rectangle = seen_rectangle(r);
    ASSERT_TRUE(rectangle.is_near());
    std::array<int, kCells * kCells> counts{};
    for (int i = 0; i < kSamples; ++i) {
      const Vec4d u = Sampler(1, 0, i, 0, 0).get_4d_fine(0);
      const auto [s, t] = rectangle.sample(u.x, u.y);
      const int column = std::min(static_cast<int>(s * kCells), kCells - 1);
      const int row = std::min(static_cast<int>(t * kCells), kCells - 1);
      ++counts.at(static_cast<std::size_t>(row * kCells + column));
    }
    double chi = 0;
    for (int k = 0; k < kCells * kCells; ++k) {
      const int row = k / kCells, column = k % kCells;
      const Sides cell = {r.at(1.0 * column / kCells, 1.0 * row / kCells),
                          r.along_s * (1.0 / kCells), r.along_t * (1.0 / kCells)};
      const double expected =
          kSamples * seen_rectangle(cell).solid_angle() / rectangle.solid_angle();
      const double off = counts.at(static_cast<std::size_t>(k)) - expected;
      chi += off * off / expected;
    }
    EXPECT_LT(chi, 44);  // 15 degrees of freedom: exceeded once in 10,000 times
  }
}

TEST(SphericalRectangle, ExtremeRandomNumbersAreSafe) {  // hard case 63
  for (const Sides& r : rectangles()) {
    for (const double u1 : {0.0, 0x1p-53, 0.5, 1 - 0x1p-53}) {
      for (const double u2 : {0.0, 0x1p-53, 0.5, 1 - 0x1p-53}) {
        const auto [s, t] = seen_rectangle(r).sample(u1, u2);
        ASSERT_TRUE(s >= 0 && s <= 1 && t >= 0 && t <= 1) << u1 << ' ' << u2;
        // Extreme random numbers give the ends of the sides.
        EXPECT_NEAR(s, u1 < 0.1 ? 0 : u1 > 0.9 ? 1 : s, 1e-6);
        EXPECT_NEAR(t, u2 < 0.1 ? 0 : u2 > 0.9 ? 1 : t, 1e-6);
      }
    }
  }
}

}  // namespace
}  // namespace tessera::render
