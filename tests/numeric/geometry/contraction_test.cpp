// Hard case 3, compiled with -ffp-contract=fast on purpose: the triangle test stays watertight even
// if the flag that forbids contraction is lost. Uses headers only, because the linker would choose
// between two copies of a function.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "worker/geometry/triangle.h"

namespace tessera::render {
namespace {

struct Sphere {
  std::vector<Vec3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// 960 triangles of radius 2.
Sphere sphere() {
  constexpr std::uint32_t kRows = 16, kColumns = 32;
  Sphere s;
  for (std::uint32_t row = 0; row <= kRows; ++row) {
    for (std::uint32_t column = 0; column < kColumns; ++column) {
      const double theta = 3.141592653589793 * row / kRows;
      const double phi = 6.283185307179586 * column / kColumns;
      const double r = row == 0 || row == kRows ? 0 : std::sin(theta);
      s.vertices.push_back({static_cast<float>(2 * r * std::cos(phi)),
                            static_cast<float>(2 * std::cos(theta)),
                            static_cast<float>(2 * r * std::sin(phi))});
    }
  }
  for (std::uint32_t row = 0; row < kRows; ++row) {
    for (std::uint32_t column = 0; column < kColumns; ++column) {
      const std::uint32_t a = row * kColumns + column, b = row * kColumns + (column + 1) % kColumns;
      if (row > 0) s.triangles.push_back({a, b, a + kColumns});
      if (row + 1 < kRows) s.triangles.push_back({b, b + kColumns, a + kColumns});
    }
  }
  return s;
}

TEST(Contraction, SharedEdgesDoNotLeak) {
  const Sphere s = sphere();
  ASSERT_EQ(s.triangles.size(), 960u);
  const Box3f bounds = {{-2, -2, -2}, {2, 2, 2}};
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-1, 1);
  int missed = 0;
  for (int i = 0; i < 60'000; ++i) {  // as for the edges and vertices of watertight_test.cpp
    const auto& triangle = s.triangles[random() % s.triangles.size()];
    const Vec3f& a = s.vertices[triangle[random() % 3]];
    const Vec3f& b = s.vertices[triangle[random() % 3]];
    const Vec3f target = lerp(a, b, i % 2 == 0 ? 0.5f + 0.5f * uniform(random) : 0.0f);
    const float x = uniform(random), y = uniform(random);
    const Vec3f origin = {x, y, uniform(random)};
    ObjectRay ray;
    ASSERT_TRUE(make_object_ray(origin, target - origin, bounds, ray));
    bool found = false;
    for (const auto& t : s.triangles) {
      TriangleHit hit{};
      found = found ||
              (intersect_triangle(ray, s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]], hit) &&
               hit.t >= 0);
    }
    if (!found) ++missed;
  }
  EXPECT_EQ(missed, 0);
}

}  // namespace
}  // namespace tessera::render
