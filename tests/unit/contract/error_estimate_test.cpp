#include "contract/stopping/error_estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "contract/version.h"

namespace tessera::contract {
namespace {

/// Error estimate and true squared error of pixels whose replicates are normal with the given
/// standard deviations, with denominator 1.
struct Drawn {
  ErrorSums sums;
  double true_square = 0;
};

Drawn draw(std::mt19937_64& rng, int pixels, double spread) {
  std::normal_distribution<double> normal;
  Drawn drawn;
  drawn.sums.pixels = pixels;
  for (int pixel = 0; pixel < pixels; ++pixel) {
    const double sigma = std::exp(spread * (pixel % 7 - 3));
    double scaled = 0;
    for (int channel = 0; channel < 3; ++channel) {
      double x[kReplicates], mean = 0, squares = 0;
      for (double& value : x) mean += (value = sigma * normal(rng)) / kReplicates;
      for (const double value : x) squares += (value - mean) * (value - mean);
      scaled += squares / (kReplicates * (kReplicates - 1));
      drawn.true_square += mean * mean / (3 * pixels);
    }
    drawn.sums.scaled += scaled;
    drawn.sums.cautious += scaled;
    drawn.sums.cautious_squares += scaled * scaled;
  }
  return drawn;
}

TEST(ErrorEstimate, BoundCoversTrueErrorAt95Percent) {
  // 95 % nominal over 2,000 seeds: fewer than 1,877 would occur once in 10,000 times (binomial).
  // The three channels of a pixel are independent here, which only widens the bound.
  for (const double spread : {0.0, 0.3}) {
    std::mt19937_64 rng(7);
    int covered = 0;
    for (int seed = 0; seed < 2000; ++seed) {
      const Drawn drawn = draw(rng, 512, spread);
      if (drawn.true_square <= upper_mean(drawn.sums, 1)) ++covered;
    }
    EXPECT_GE(covered, 1877) << "spread " << spread;
    if (spread == 0) {
      EXPECT_LE(covered, 1935) << "the bound must not be loose: √R is exact for normal errors";
    }
  }
}

TEST(ErrorEstimate, BoundCoversErrorOfFewPixels) {
  // Pixels with equal deviations, one channel: the ratio of true and estimated square has an F
  // distribution. 95 % nominal; fewer than 1,877 of 2,000 would occur once in 10,000 times.
  std::normal_distribution<double> normal;
  for (const int carriers : {1, 2, 4, 8, 16}) {
    std::mt19937_64 rng(11);
    int covered = 0;
    for (int seed = 0; seed < 2000; ++seed) {
      ErrorSums sums;
      sums.pixels = 4096;
      double truth = 0;
      for (int pixel = 0; pixel < carriers; ++pixel) {
        double x[kReplicates], mean = 0, scaled = 0;
        for (double& value : x) mean += (value = normal(rng)) / kReplicates;
        for (const double value : x) scaled += (value - mean) * (value - mean) / 12;
        sums.cautious += scaled;
        sums.cautious_squares += scaled * scaled;
        truth += mean * mean / (3 * 4096);
      }
      if (truth <= upper_mean(sums, 1)) ++covered;
    }
    EXPECT_GE(covered, 1877) << carriers << " pixels";
  }
}

TEST(ErrorEstimate, BoundOfOnePixelIsFinite) {
  const ErrorSums sums{4096, 1, 1, 1, 1, 1};
  EXPECT_GT(upper_mean(sums, 32), 10 * mean_cautious(sums));
  EXPECT_LT(upper_mean(sums, 32), 1000 * mean_cautious(sums));
}

TEST(ErrorEstimate, LooksShareConfidence) {
  std::mt19937_64 rng(3);
  const ErrorSums sums = draw(rng, 512, 0).sums;
  const double mean = mean_cautious(sums);
  // With x = z s / mean, the bound is mean (1 + 2 x / (1 − x/2)).
  const auto quantile = [mean](double bound) {
    const double excess = bound / mean - 1;
    return excess / (2 + excess / 2);
  };
  const double one = quantile(upper_mean(sums, 1));
  for (int looks = 1; looks <= 32; ++looks) {
    // z is the quantile of the tail 0.05/looks: erfc(z/√2)/2 returns the tail.
    const double z = quantile(upper_mean(sums, looks)) / one * 1.6448536269514722;
    EXPECT_NEAR(std::erfc(z / std::sqrt(2.0)) / 2 * looks, 0.05, 1e-8) << looks << " looks";
  }
}

TEST(ErrorEstimate, ScalingSumsScalesEveryFigure) {
  std::mt19937_64 rng(5);
  const ErrorSums sums = draw(rng, 64, 0.2).sums;
  const ErrorSums quarter = sums.scaled_by(0.25);
  EXPECT_DOUBLE_EQ(mean_cautious(quarter), mean_cautious(sums) / 4);
  EXPECT_NEAR(upper_mean(quarter, 3), upper_mean(sums, 3) / 4, 1e-15);
  EXPECT_NEAR(effective_pixels(quarter), effective_pixels(sums), 1e-9);
}

TEST(ErrorEstimate, SubtractingPartLeavesRest) {
  std::mt19937_64 rng(6);
  const ErrorSums part = draw(rng, 64, 0.2).sums, rest = draw(rng, 128, 0.1).sums;
  ErrorSums whole = rest;
  whole.add(part);
  const ErrorSums left = whole.without(part);
  EXPECT_EQ(left.pixels, 128);
  EXPECT_NEAR(mean_cautious(left), mean_cautious(rest), 1e-13 * mean_cautious(whole));
  EXPECT_NEAR(effective_pixels(left), effective_pixels(rest), 1e-11 * effective_pixels(rest));
}

TEST(ErrorEstimate, OnePixelErrorIsOneEffectivePixel) {
  ErrorSums sums;
  sums.pixels = 100;
  sums.cautious = 3;
  sums.cautious_squares = 9;
  EXPECT_EQ(effective_pixels(sums), 1);
  EXPECT_EQ(effective_pixels(ErrorSums{100, 0, 0, 0, 0, 0}), 0)
      << "without error there is nothing to bound";
}

}  // namespace
}  // namespace tessera::contract
