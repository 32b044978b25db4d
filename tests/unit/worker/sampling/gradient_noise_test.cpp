#include "worker/sampling/gradient_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

/// A point of a wide cube, hashed from i: 2^22 cells a side, so that points rarely share a cell.
std::array<double, 4> point(std::uint64_t i) {
  std::array<double, 4> p;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::uint64_t bits = mix(mix(4 * i + k + 99));
    p[k] = (static_cast<double>(bits >> 11) * 0x1p-53 - 0.5) * 0x1p22;
  }
  return p;
}

TEST(GradientNoise, IsZeroOnLatticeAndBounded) {
  for (int dimensions = 1; dimensions <= 4; ++dimensions) {
    double most = 0;
    for (std::uint64_t i = 0; i < 1 << 17; ++i) {
      std::array<double, 4> p = point(i);
      most = std::max(most, std::fabs(double{gradient_noise(dimensions, p, 5)}));
      for (double& x : p) x = std::floor(x);
      ASSERT_EQ(gradient_noise(dimensions, p, 5), 0) << dimensions;
    }
    EXPECT_LE(most, 1) << dimensions;
    EXPECT_GT(most, 0.7) << dimensions;
  }
}

/// Integral over [0, 1] of (1 - s)^2 x^power, s = 6 x^5 - 15 x^4 + 10 x^3.
double fade_integral(int power) {
  constexpr int kSteps = 20000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = (i + 0.5) / kSteps, s = x * x * x * (x * (x * 6 - 15) + 10);
    sum += (1 - s) * (1 - s) * std::pow(x, power);
  }
  return sum / kSteps;
}

/// With gradients independent, of mean 0 and covariance c I at each corner, the variance at a point
/// is c times the sum over corners of weight^2 times distance^2; its mean over a cell of N
/// dimensions is c 2^N N B A^(N-1), A and B the integrals of fade^2 and fade^2 x^2.
TEST(GradientNoise, MomentsMatchIndependentGradients) {
  const double scaled_covariance[] = {4, 2 * 0.5, 8.0 / 12, 24.0 / 32 * 4 / 9};
  const double a = fade_integral(0), b = fade_integral(2);
  constexpr double kCount = 1 << 20;
  for (int n = 1; n <= 4; ++n) {
    double sum = 0, squares = 0, fourth = 0, absolute = 0, ridge = 0, ridge2 = 0;
    for (std::uint64_t i = 0; i < 1 << 20; ++i) {
      const double x = gradient_noise(n, point(i), 17);
      const double r = (1 - std::fabs(x)) * (1 - std::fabs(x));
      sum += x, squares += x * x, fourth += x * x * x * x, absolute += std::fabs(x);
      ridge += r, ridge2 += r * r;
    }
    const double variance = scaled_covariance[n - 1] * std::pow(2, n) * n * b * std::pow(a, n - 1);
    const double mean_square = squares / kCount;
    EXPECT_NEAR(sum / kCount, 0, 4 * std::sqrt(mean_square / kCount)) << n;
    EXPECT_NEAR(mean_square, variance,
                4 * std::sqrt((fourth / kCount - mean_square * mean_square) / kCount))
        << n;
    const double mean = absolute / kCount, mean_ridge = ridge / kCount;
    EXPECT_NEAR(mean, double{kMeanAbsoluteNoise[static_cast<std::size_t>(n)]},
                4 * std::sqrt((mean_square - mean * mean) / kCount) + 1e-4)
        << n;
    EXPECT_NEAR(mean_ridge, double{kMeanRidgedNoise[static_cast<std::size_t>(n)]},
                4 * std::sqrt((ridge2 / kCount - mean_ridge * mean_ridge) / kCount) + 1e-4)
        << n;
  }
}

TEST(GradientNoise, IsSmoothAcrossCells) {
  for (int n = 1; n <= 4; ++n) {
    for (std::uint64_t i = 0; i < 1000; ++i) {
      for (std::size_t k = 0; k < static_cast<std::size_t>(n); ++k) {
        std::array<double, 4> p = point(i);
        for (double& x : p) x = std::fmod(x, 64.0);  // where 2^-10 is a small step of a float
        p[k] = std::floor(p[k]);
        constexpr double kStep = 0x1p-10;
        const auto at = [&](double steps) {
          std::array<double, 4> q = p;
          q[k] += steps * kStep;
          return double{gradient_noise(n, q, 3)};
        };
        // Slopes on both sides of a cell boundary: equal except for the second derivative, below
        // 60.
        const double before = (at(0) - at(-1)) / kStep, after = (at(1) - at(0)) / kStep;
        ASSERT_NEAR(before, after, 60 * kStep) << n;
      }
    }
  }
}

TEST(GradientNoise, SeedsGiveDistinctStableValues) {
  std::set<float> seen;
  for (std::uint32_t seed = 0; seed < 100; ++seed) {
    seen.insert(gradient_noise(3, {0.3, 0.4, 0.6, 0}, seed));
  }
  EXPECT_GT(seen.size(), 95u);
  EXPECT_EQ(gradient_noise(3, {1e300, 0.5, 0.5, 0}, 0), 0);
  EXPECT_EQ(gradient_noise(2, {NAN, 0.5, 0, 0}, 0), 0);
  // The same on every machine and compiler.
  EXPECT_EQ(gradient_noise(1, {12.25, 0, 0, 0}, 1), -0x1.35p-1f);
  EXPECT_EQ(gradient_noise(2, {12.25, -3.7, 0, 0}, 1), -0x1.18be9ep-2f);
  EXPECT_EQ(gradient_noise(3, {12.25, -3.7, 100.1, 0}, 1), 0x1.90215ap-3f);
  EXPECT_EQ(gradient_noise(4, {12.25, -3.7, 100.1, -0.3}, 1), 0x1.a188ecp-4f);
}

}  // namespace
}  // namespace tessera::render
