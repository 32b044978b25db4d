#include "worker/math/vector.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "worker/math/float_bits.h"
#include "worker/math/transform.h"

namespace tessera::render {
namespace {

TEST(Vector, DifferenceOfProductsDoesNotCancel) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (int i = 0; i < 200'000; ++i) {
    const float a = uniform(random), b = uniform(random), c = next_up(a), d = next_down(b);
    // Exact in double: products of floats have 48 bits, and the two differ by 2^-50 at least.
    const double exact = static_cast<double>(a) * b - static_cast<double>(c) * d;
    const float got = difference_of_products(a, b, c, d);
    ASSERT_NEAR(got, exact, 2 * std::fabs(exact) * 0x1p-23);
    ASSERT_EQ(std::signbit(got) && got != 0, exact < 0);
  }
}

TEST(Vector, NormalizeWorksAtEveryScale) {
  for (const float scale : {1e-38f, 1e-20f, 1.0f, 1e20f, 3e38f}) {
    const Vec3f n = normalize(Vec3f{scale, -0.5f * scale, 0.25f * scale});
    EXPECT_NEAR(length(n), 1, 2e-7f) << scale;
    EXPECT_NEAR(n.x, 0.87287156f, 2e-7f) << scale;
  }
  EXPECT_EQ(normalize(Vec3f{}), Vec3f{});
}

TEST(Vector, MaxAbsCountsNanAsZero) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(max_abs(Vec3f{nan, -3, 2}), 3);
  EXPECT_EQ(max_abs(Vec3f{1, nan, -2}), 2);
  EXPECT_EQ(max_abs(Vec3f{-4, 1, nan}), 4);
}

TEST(Transform, InverseUndoesTransform) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 1000; ++i) {
    Affine3d m;
    for (Vec3d& row : m.rows) row = {uniform(random), uniform(random), uniform(random)};
    m.translation = {uniform(random), uniform(random), uniform(random)};
    if (std::fabs(determinant(m)) < 1e-3) continue;
    const auto back = inverse(m);
    ASSERT_TRUE(back.has_value());
    const Vec3d p = {uniform(random), uniform(random), uniform(random)};
    const Vec3d there_and_back = transform_point(*back, transform_point(m, p));
    ASSERT_LT(max_abs(there_and_back - p), 1e-10);
  }
}

TEST(Transform, SingularMatricesHaveNoInverse) {
  Affine3d flat;
  flat.rows[2] = {0, 0, 0};
  EXPECT_FALSE(inverse(flat).has_value());
  Affine3d broken;
  broken.rows[1].y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(inverse(broken).has_value());
  Affine3d tiny;
  for (int i = 0; i < 3; ++i) tiny.rows[static_cast<std::size_t>(i)] *= 1e-200;
  EXPECT_FALSE(inverse(tiny).has_value());
}

TEST(FloatBits, NeighboursMatchNextafter) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float x : {0.0f, -0.0f, 1.0f, -1.0f, 0x1p-149f, -0x1p-149f, 0x1p-126f, 3.4e38f}) {
    EXPECT_EQ(next_up(x), std::nextafter(x, kInfinity)) << x;
    EXPECT_EQ(next_down(x), std::nextafter(x, -kInfinity)) << x;
  }
  EXPECT_EQ(next_up(std::numeric_limits<float>::max()), kInfinity);
}

}  // namespace
}  // namespace tessera::render
