// Errors of regions of a denoised frame: sums against plain ones, and estimates against known
// errors.

#include "image/denoise/region_errors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "image/denoise/denoised_error.h"

namespace tessera::image {
namespace {

/// Adds a pixel with equal channels, given the errors of both halves and the noise of the four
/// streams.
void add_pixel(RegionSums& region, double first, double second,
               const std::array<double, 4>& noise) {
  ++region.pixels;
  for (RegionSums::Channel& channel : region.channels) {
    for (std::size_t k = 0; k < 2; ++k) {
      channel.first[k] += first - noise[2 + k];
      channel.second[k] += second - noise[k];
    }
    channel.between += first - second;
    channel.first_noise += 0.5 * (noise[2] - noise[3]) * (noise[2] - noise[3]);
    channel.second_noise += 0.5 * (noise[0] - noise[1]) * (noise[0] - noise[1]);
  }
}

TEST(RegionErrors, EqualErrorsOfPixelsAddUp) {
  RegionSums region;
  for (int i = 0; i < 10; ++i) add_pixel(region, 0.3, 0.1, {});
  // The mean of the halves has the error 0.2 in 10 pixels of three channels.
  EXPECT_NEAR(region.estimate().scaled, 10 * 3 * 0.04, 1e-12);
  EXPECT_EQ(region.estimate().spread, 0);
}

TEST(RegionErrors, OppositeErrorsOfPixelsCancel) {
  RegionSums region;
  for (int i = 0; i < 10; ++i)
    add_pixel(region, i % 2 == 0 ? 0.3 : -0.3, i % 2 == 0 ? 0.3 : -0.3, {});
  EXPECT_NEAR(region.estimate().scaled, 0, 1e-12);
}

TEST(RegionErrors, EmptyRegionHasNone) {
  EXPECT_EQ(RegionSums().estimate().scaled, 0);
  EXPECT_EQ(RegionSums().estimate().spread, 0);
}

TEST(RegionErrors, PixelThatIsNotANumberMakesTheErrorSo) {
  DenoiseSums sums;
  RegionGrid grid(8, 8);
  add_pixel(grid.at(0, 0), 0.1, 0.1, {});
  add_pixel(grid.at(7, 7), NAN, 0.1, {});
  grid.add_to(sums.by_regions, sums.frame);
  sums.pixels = 2;
  EXPECT_TRUE(std::isnan(denoised_error(sums).error));
  EXPECT_TRUE(std::isnan(denoised_error(sums).error_upper95));
}

/// Mean and spread of the estimate over many regions with noise.
TEST(RegionErrors, EstimateIsUnbiasedWithSpreadOfItsNoise) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  constexpr int kRegions = 20000, kPixels = 16;
  double sum = 0, squares = 0, spread = 0;
  for (int i = 0; i < kRegions; ++i) {
    RegionSums region;
    for (int k = 0; k < kPixels; ++k) {
      add_pixel(region, 0.5, 0.5, {normal(random), normal(random), normal(random), normal(random)});
    }
    const ErrorEstimate estimate = region.estimate();
    sum += estimate.scaled / kRegions;
    squares += estimate.scaled * estimate.scaled / kRegions;
    spread += estimate.spread / kRegions;
  }
  constexpr double kExpected = kPixels * 3 * 0.25;
  const double variance = squares - sum * sum;
  EXPECT_NEAR(sum, kExpected, 4 * std::sqrt(variance / kRegions));
  // A bound: it allows for dependent halves, so it is about twice the variance.
  EXPECT_GE(spread, variance);
  EXPECT_LE(spread, 2.5 * variance);
}

TEST(RegionErrors, GridSumsSquaresOfEachSide) {
  constexpr std::size_t kWidth = 70, kHeight = 41;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  RegionGrid grid(kWidth, kHeight);
  std::vector<std::array<double, 5>> pixels;
  for (std::size_t y = 0; y < kHeight; ++y) {
    for (std::size_t x = 0; x < kWidth; ++x) {
      pixels.push_back({normal(random), normal(random), normal(random), normal(random), 0.5});
      const auto& p = pixels.back();
      add_pixel(grid.at(x, y), p[4], 0.25, {p[0], p[1], p[2], p[3]});
    }
  }
  std::array<ErrorEstimate, kRegionSides> estimates;
  RegionSums whole;
  grid.add_to(estimates, whole);
  std::size_t side = kLeastRegionSide;
  for (const ErrorEstimate& estimate : estimates) {
    ErrorEstimate plain;
    for (std::size_t top = 0; top < kHeight; top += side) {
      for (std::size_t left = 0; left < kWidth; left += side) {
        RegionSums region;
        for (std::size_t y = top; y < std::min(top + side, kHeight); ++y) {
          for (std::size_t x = left; x < std::min(left + side, kWidth); ++x) {
            const auto& p = pixels[y * kWidth + x];
            add_pixel(region, p[4], 0.25, {p[0], p[1], p[2], p[3]});
          }
        }
        plain.add(region.estimate());
      }
    }
    EXPECT_NEAR(estimate.scaled, plain.scaled, 1e-9 * plain.scaled) << side;
    EXPECT_NEAR(estimate.spread, plain.spread, 1e-9 * plain.spread) << side;
    side *= 2;
  }
  EXPECT_EQ(whole.pixels, static_cast<std::int64_t>(kWidth * kHeight));
}

/// Half of the light arrives in one of 100 samples, and the filter has removed it.
TEST(RegionErrors, LightThatTheFilterRemovedIsFound) {
  constexpr int kWidth = 64, kHeight = 64, kSeeds = 40;
  constexpr double kChance = 0.01, kSpike = 50, kLost = -kChance * kSpike;
  int held = 0;
  double mean = 0;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    std::mt19937 random(seed);
    std::bernoulli_distribution is_spike(kChance);
    DenoiseSums sums;
    RegionGrid grid(kWidth, kHeight);
    for (std::size_t i = 0; i < std::size_t{kWidth} * kHeight; ++i) {
      std::array<double, 4> noise{};
      for (double& value : noise) value = (is_spike(random) ? kSpike : 0) + kLost;
      add_pixel(grid.at(i % kWidth, i / kWidth), kLost, kLost, noise);
      ++sums.pixels;
    }
    grid.add_to(sums.by_regions, sums.frame);
    const DenoisedError error = denoised_error(sums);
    held += error.error_upper95 >= -kLost ? 1 : 0;
    mean += error.error * error.error / kSeeds;
  }
  EXPECT_GE(held, kSeeds - 5);
  EXPECT_GE(mean, 0.9 * kLost * kLost);
  EXPECT_LE(mean, 1.3 * kLost * kLost) << "the largest of seven estimates is a little too large";
}

}  // namespace
}  // namespace tessera::image
