#include "worker/sampling/distribution.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "worker/sampling/pixel_filter.h"

namespace tessera::render {
namespace {

constexpr double kBelowOne = 1 - 0x1p-53;

TEST(DiscreteDistribution, FrequenciesMatchWeights) {
  const std::vector<double> weights = {1, 0, 3, 0, 0, 4, 0};
  const DiscreteDistribution table(weights);
  std::vector<int> count(weights.size(), 0);
  constexpr int kSteps = 8000;
  for (int i = 0; i < kSteps; ++i) {
    ++count[static_cast<std::size_t>(table.sample((i + 0.5) / kSteps).index)];
  }
  for (std::size_t i = 0; i < weights.size(); ++i) {
    EXPECT_EQ(count[i], static_cast<int>(weights[i] * kSteps / 8));
  }
  EXPECT_EQ(table.total(), 8);
}

TEST(DiscreteDistribution, ZeroWeightIsNeverChosen) {
  std::mt19937 random(5);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> weights(1 + random() % 30);
    for (double& w : weights) {
      w = random() % 3 == 0 ? 0 : std::ldexp(1.0, static_cast<int>(random() % 80) - 40);
    }
    weights[random() % weights.size()] = 1;
    const DiscreteDistribution table(weights);
    double sum = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const float p = table.probability(static_cast<std::int32_t>(i));
      EXPECT_EQ(p > 0, weights[i] > 0);
      sum += p;
    }
    EXPECT_NEAR(sum, 1, 1e-6);
    for (const double u : {0.0, 0x1p-32, 0.25, 0.5, 0.75, 1 - 0x1p-24, kBelowOne, 1.0}) {
      const DiscreteDistribution::Choice choice = table.sample(u);
      ASSERT_GT(weights[static_cast<std::size_t>(choice.index)], 0);
      ASSERT_EQ(choice.pdf, table.probability(choice.index));
      ASSERT_TRUE(choice.remapped >= 0 && choice.remapped < 1);
    }
  }
}

TEST(DiscreteDistribution, RemappedNumberIsUniform) {
  const DiscreteDistribution table(std::vector<double>{1, 2, 5});
  EXPECT_FLOAT_EQ(table.sample(0.0625).remapped, 0.5f);
  EXPECT_FLOAT_EQ(table.sample(0.125 + 0.0625).remapped, 0.25f);
  EXPECT_FLOAT_EQ(table.sample(0.375 + 0.625 * 0.75).remapped, 0.75f);
}

TEST(DiscreteDistribution, InvalidWeightsAreHandled) {
  const double inf = std::numeric_limits<double>::infinity();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const DiscreteDistribution odd(std::vector<double>{nan, 1e308, -3, inf, 1e308, 1e-300});
  EXPECT_EQ(odd.probability(0), 0);
  EXPECT_NEAR(odd.probability(1), 0.5, 1e-6);
  EXPECT_EQ(odd.probability(2), 0);
  EXPECT_EQ(odd.probability(3), 0);
  EXPECT_GT(odd.probability(5), 0);
  EXPECT_TRUE(DiscreteDistribution(std::vector<double>{0, 0}).empty());
  EXPECT_TRUE(DiscreteDistribution().empty());
}

/// Mean and variance of the placed offsets along x.
std::pair<double, double> moments(contract::PixelFilter filter, double width) {
  const PixelFilterSampler sampler(filter, width);
  constexpr int kSteps = 100'000;
  double sum = 0, square = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = sampler.sample({(static_cast<float>(i) + 0.5f) / kSteps, 0.5f}).x;
    sum += x;
    square += x * x;
  }
  const double mean = sum / kSteps;
  return {mean, square / kSteps - mean * mean};
}

TEST(PixelFilter, OffsetMomentsMatchFilter) {
  const auto box = moments(contract::PixelFilter::box, 2);
  EXPECT_NEAR(box.first, 0, 1e-6);
  EXPECT_NEAR(box.second, 4.0 / 12, 1e-5);
  // A normal distribution truncated at 3 sigma has 1 - 6 phi(3) / (2 Phi(3) - 1) of its variance.
  const double phi = std::exp(-4.5) / std::sqrt(2 * 3.14159265358979);
  const double kept = 1 - 6 * phi / std::erf(3 / std::sqrt(2.0));
  const auto gaussian = moments(contract::PixelFilter::gaussian, 3);
  EXPECT_NEAR(gaussian.first, 0, 1e-5);
  EXPECT_NEAR(gaussian.second, 0.25 * kept, 2e-5);
  // Variance of a0 - a1 cos + a2 cos - a3 cos over one period of width 1: 1/12 plus
  // a_k (-1)^k (-1)^k / (2 pi^2 k^2) / a0 with the signs of the window: 0.022303.
  const double pi2 = 3.14159265358979 * 3.14159265358979;
  const double variance = 1.0 / 12 + (-0.48829 + 0.14128 / 4 - 0.01168 / 9) / (2 * pi2 * 0.35875);
  const auto harris = moments(contract::PixelFilter::blackman_harris, 3);
  EXPECT_NEAR(harris.first, 0, 1e-5);
  EXPECT_NEAR(harris.second, 9 * variance, 1e-4);
}

TEST(PixelFilter, OffsetsStayInsideSupport) {
  for (const auto filter : {contract::PixelFilter::box, contract::PixelFilter::gaussian,
                            contract::PixelFilter::blackman_harris}) {
    const PixelFilterSampler sampler(filter, 3);
    for (const float u : {0.0f, 0x1p-24f, 0.5f, 1 - 0x1p-24f}) {
      const Vec2f p = sampler.sample({u, u});
      EXPECT_TRUE(p.x >= -1.5f && p.x < 1.5f) << u;
      EXPECT_EQ(p.x, p.y);
    }
    EXPECT_NEAR(sampler.sample({0.5f, 0.5f}).x, 0, 1e-6);
  }
}

}  // namespace
}  // namespace tessera::render
