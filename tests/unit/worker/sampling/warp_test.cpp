#include "worker/sampling/warp.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace tessera::render {
namespace {

constexpr int kSide = 512;
constexpr float kLargestFloatBelowOne = 1 - 0x1p-24f;

/// Mean of f over midpoints of a fine grid of the unit square.
template <typename F>
double grid_mean(F f) {
  double sum = 0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      sum +=
          f(Vec2f{(static_cast<float>(x) + 0.5f) / kSide, (static_cast<float>(y) + 0.5f) / kSide});
    }
  }
  return sum / (kSide * kSide);
}

/// All corners and edge midpoints of the unit square, where maps are likely to fail.
std::vector<Vec2f> corners() {
  std::vector<Vec2f> all;
  for (const float x : {0.0f, 0x1p-24f, 0.5f, kLargestFloatBelowOne}) {
    for (const float y : {0.0f, 0x1p-24f, 0.5f, kLargestFloatBelowOne}) all.push_back({x, y});
  }
  return all;
}

TEST(Warp, CosineHemisphereMomentsMatchDensity) {
  // E z = 2/3, E z^2 = 1/2, E x^2 = 1/4 under cos / pi. Midpoint error is O(1/side).
  EXPECT_NEAR(grid_mean([](Vec2f u) { return warp::cosine_hemisphere(u).z; }), 2.0 / 3, 1e-4);
  EXPECT_NEAR(grid_mean([](Vec2f u) {
                const float z = warp::cosine_hemisphere(u).z;
                return z * z;
              }),
              0.5, 1e-4);
  EXPECT_NEAR(grid_mean([](Vec2f u) {
                const float x = warp::cosine_hemisphere(u).x;
                return x * x;
              }),
              0.25, 1e-4);
}

TEST(Warp, HemisphereAndSphereAreUniform) {
  EXPECT_NEAR(grid_mean([](Vec2f u) { return warp::uniform_hemisphere(u).z; }), 0.5, 1e-5);
  EXPECT_NEAR(grid_mean([](Vec2f u) { return warp::uniform_sphere(u).z; }), 0, 1e-5);
  EXPECT_NEAR(grid_mean([](Vec2f u) {
                const Vec3f d = warp::uniform_sphere(u);
                return d.z * d.z;
              }),
              1.0 / 3, 1e-5);
  EXPECT_NEAR(grid_mean([](Vec2f u) {
                const Vec3f d = warp::uniform_sphere(u);
                return d.x * d.x;
              }),
              1.0 / 3, 1e-5);
}

TEST(Warp, DirectionsAreUnitAndOnTheirSide) {
  for (const Vec2f& u : corners()) {
    EXPECT_NEAR(length(warp::cosine_hemisphere(u)), 1, 5e-4);
    EXPECT_GT(warp::cosine_hemisphere(u).z, 0);
    EXPECT_NEAR(length(warp::uniform_hemisphere(u)), 1, 1e-6);
    EXPECT_GT(warp::uniform_hemisphere(u).z, 0);
    EXPECT_NEAR(length(warp::uniform_sphere(u)), 1, 1e-6);
    const Vec2f d = warp::disk(u);
    EXPECT_LE(d.x * d.x + d.y * d.y, 1 + 1e-6f);
  }
}

TEST(Warp, TrianglePointsAreUniformAndInside) {
  // Each quarter of the triangle gets a quarter of the points; the first moments are the
  // centroid's.
  int quarter[4] = {0, 0, 0, 0};
  const double mean = grid_mean([&](Vec2f u) {
    const Vec2f b = warp::uniform_triangle(u);
    EXPECT_TRUE(b.x >= 0 && b.y >= 0 && b.x + b.y <= 1);
    const float b0 = 1 - b.x - b.y;
    ++quarter[b0 > 0.5f ? 0 : b.x > 0.5f ? 1 : b.y > 0.5f ? 2 : 3];
    return b.x;
  });
  EXPECT_NEAR(mean, 1.0 / 3, 1e-5);
  constexpr int kQuarter = kSide * kSide / 4;
  for (const int count : quarter) EXPECT_NEAR(count, kQuarter, kSide * 2);
  for (const Vec2f& u : corners()) {
    const Vec2f b = warp::uniform_triangle(u);
    EXPECT_TRUE(b.x >= 0 && b.y >= 0 && b.x + b.y <= 1);
  }
}

TEST(Warp, MapsAreContinuous) {
  // Neighbours on the grid map to neighbours: no jump above a few cell sizes.
  const auto near = [](const Vec3f& a, const Vec3f& b, float most) { return length(a - b) < most; };
  for (int i = 0; i + 1 < kSide; ++i) {
    for (int j = 0; j < kSide; j += 37) {
      const float a = (static_cast<float>(i) + 0.5f) / kSide, b = a + 1.0f / kSide;
      const float other = (static_cast<float>(j) + 0.5f) / kSide;
      const Vec2f p = warp::disk({a, other}), q = warp::disk({b, other});
      ASSERT_TRUE(near({p.x, p.y, 0}, {q.x, q.y, 0}, 5.0f / kSide));
      const Vec2f s = warp::uniform_triangle({a, other}), t = warp::uniform_triangle({b, other});
      ASSERT_TRUE(near({s.x, s.y, 0}, {t.x, t.y, 0}, 3.0f / kSide));
    }
  }
}

}  // namespace
}  // namespace tessera::render
