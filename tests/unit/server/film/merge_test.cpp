#include "server/film/merge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/unit/server/film/made_blocks.h"

namespace tessera::server {
namespace {

using contract::FilmBlock;
using contract::kReplicates;

/// A block of one pixel whose replicates have these red sums; grey, alpha 1 per sample.
FilmBlock one_pixel(const std::vector<float>& red, std::int32_t samples, bool first) {
  FilmBlock block = FilmBlock::zeros({1, 1, 0, first});
  for (std::size_t r = 0; r < red.size(); ++r) block.rgb[3 * r] = red[r];
  block.alpha[0] = static_cast<float>(samples);
  return block;
}

float red_of(const TileSum& tile) {
  float rgba[4];
  tile.rgba(0, rgba);
  return rgba[0];
}

TEST(TileSum, MeanIsRoundedOnce) {
  TileSum tile(1, 1, 0);
  // 2^24 and 1: float sums would lose the ones; double keeps them until the division.
  ASSERT_TRUE(tile.add(one_pixel({0x1p24f, 1, 1, 1}, 4, true), {0, 4}).ok());
  ASSERT_TRUE(tile.add(one_pixel({1, 1, 1, 1}, 4, false), {4, 4}).ok());
  EXPECT_EQ(red_of(tile), static_cast<float>((0x1p24 + 7.0) / 8));
  EXPECT_NE(red_of(tile), static_cast<float>((0x1p24 + 4.0) / 8));
}

TEST(TileSum, LongSumsStayWithinRounding) {
  // Hard case 67: 512 samples a pass, 2,000 passes with means between 0.05 and 0.15. Each block
  // rounds once to 2^-24, and so does the mean.
  TileSum tile(1, 1, 0);
  double exact = 0;
  for (int pass = 0; pass < 2000; ++pass) {
    const double mean = 0.05 + 0.1 * (pass * 37 % 101) / 100;
    exact += mean / 2000;
    const auto block_sum = static_cast<float>(mean * 128);
    const FilmBlock block = one_pixel({block_sum, block_sum, block_sum, block_sum}, 512, pass == 0);
    ASSERT_TRUE(tile.add(block, {512 * pass, 512}).ok());
  }
  EXPECT_NEAR(red_of(tile), exact, exact * 2 * 0x1p-24);
}

TEST(TileSum, DroppedSamplesAreExcludedFromMean) {
  // Hard case 70: one of replicate 1's two samples was not finite.
  FilmBlock block = one_pixel({2, 1, 2, 2}, 7, true);
  block.dropped = {{0, 1, 1}};
  TileSum tile(1, 1, 0);
  ASSERT_TRUE(tile.add(block, {0, 8}).ok());
  EXPECT_EQ(red_of(tile), 1.0f);  // 7 ÷ 7
  EXPECT_EQ(tile.kept(0), 7);
  EXPECT_EQ(tile.losses().dropped_count, 1);
  float error[3];
  tile.standard_error(0, error);
  EXPECT_EQ(error[0], 0.0f) << "each replicate's mean divides by what it kept";
}

TEST(TileSum, AllSamplesDroppedGivesBlack) {
  FilmBlock block = one_pixel({0, 0, 0, 0}, 0, true);
  for (std::uint32_t r = 0; r < kReplicates; ++r) block.dropped.push_back({0, r, 1});
  TileSum tile(1, 1, 0);
  ASSERT_TRUE(tile.add(block, {0, 4}).ok());
  float rgba[4];
  tile.rgba(0, rgba);
  for (const float value : rgba) EXPECT_EQ(value, 0.0f);
  const ErrorSums sums = tile.error_sums(1);
  EXPECT_EQ(sums.scaled, 0);
  EXPECT_EQ(sums.squared, 0);
}

TEST(TileSum, MeanAboveFloatMaxIsClamped) {
  const float huge = std::numeric_limits<float>::max();
  FilmBlock block = one_pixel({huge, huge, huge, huge}, 1, true);
  block.dropped = {{0, 0, 1}, {0, 1, 1}, {0, 2, 1}};
  TileSum tile(1, 1, 0);
  ASSERT_TRUE(tile.add(block, {0, 4}).ok());
  EXPECT_EQ(red_of(tile), huge);
}

TEST(TileSum, RejectsWrongOrderAndShape) {
  TileSum tile(1, 1, 0);
  EXPECT_FALSE(tile.add(one_pixel({1, 1, 1, 1}, 4, false), {0, 4}).ok()) << "not a first pass";
  EXPECT_FALSE(tile.add(one_pixel({1, 1, 1, 1}, 4, true), {4, 4}).ok()) << "a gap";
  EXPECT_FALSE(tile.add(FilmBlock::zeros({2, 1, 0, true}), {0, 4}).ok()) << "too wide";
  EXPECT_EQ(tile.pass_count(), 0);
  ASSERT_TRUE(tile.add(one_pixel({1, 1, 1, 1}, 4, true), {0, 4}).ok());
  EXPECT_FALSE(tile.add(one_pixel({1, 1, 1, 1}, 4, true), {0, 4}).ok()) << "a repeat";
  EXPECT_EQ(tile.sample_count(), 4);
  EXPECT_EQ(red_of(tile), 1.0f);
}

TEST(TileSum, AovMeansCoverHitsOnly) {
  const std::uint32_t aovs = contract::kAovAlbedo | contract::kAovNormal | contract::kAovDepth |
                             contract::kAovPosition | contract::kAovIds;
  FilmBlock first = FilmBlock::zeros({1, 1, aovs, true});
  first.albedo = {1, 2, 3};
  first.normal = {0, -2, 0};
  first.hits = {2};
  first.depth = {7};
  first.position = {1, 2, 3};
  first.ids = {4000000001u, 2, 3};
  FilmBlock second = FilmBlock::zeros({1, 1, aovs, false});
  second.albedo = {1, 0, 0};
  second.hits = {2};
  TileSum tile(1, 1, aovs);
  ASSERT_TRUE(tile.add(first, {0, 4}).ok());
  ASSERT_TRUE(tile.add(second, {4, 4}).ok());
  float xyz[3];
  tile.albedo(0, xyz);
  EXPECT_EQ(xyz[0], 0.5f);
  EXPECT_EQ(xyz[2], 0.75f);
  tile.normal(0, xyz);
  EXPECT_EQ(xyz[1], -0.5f);
  EXPECT_EQ(tile.first_sample().depth[0], 7.0f);
  EXPECT_EQ(tile.first_sample().position[2], 3.0f);
  EXPECT_EQ(tile.first_sample().ids[0], 4000000001u);
}

TEST(TileSum, AovWithoutHitsIsZero) {
  TileSum tile(1, 1, contract::kAovNormal);
  ASSERT_TRUE(tile.add(FilmBlock::zeros({1, 1, contract::kAovNormal, true}), {0, 4}).ok());
  float xyz[3] = {1, 1, 1};
  tile.normal(0, xyz);
  EXPECT_EQ(xyz[0], 0.0f);
}

TEST(TileSum, TraversalCostCoversDroppedSamples) {
  FilmBlock block = FilmBlock::zeros({1, 1, contract::kAovTraversalCost, true});
  block.traversal_cost = {12, 40, 6};
  block.dropped = {{0, 1, 1}};
  TileSum tile(1, 1, contract::kAovTraversalCost);
  ASSERT_TRUE(tile.add(block, {0, 4}).ok());
  block.shape.first_pass = false;
  ASSERT_TRUE(tile.add(block, {4, 4}).ok());
  float cost[3];
  tile.traversal_cost(0, cost);
  EXPECT_EQ(cost[0], 3.0f);
  EXPECT_EQ(cost[1], 10.0f);
  EXPECT_EQ(cost[2], 1.5f);
}

/// The estimator of docs/explanation/error-estimation.md, written out for one channel, in long
/// double.
struct BruteForce {
  long double squared = 0, relative = 0, scaled = 0;
};
BruteForce brute_force(const std::vector<long double>& x, long double m) {
  const auto n = static_cast<long double>(x.size());
  long double all = 0;
  for (const long double v : x) all += v;
  BruteForce sums;
  for (const long double v : x) {
    const long double square = (v - all / n) * (v - all / n), others = (all - v) / (n - 1);
    sums.squared += square / (n * (n - 1));
    sums.relative += square / (others * others + 0.01L) / (n * (n - 1));
    sums.scaled += square / (others * others + 0.01L * m * m) / (n * (n - 1));
  }
  return sums;
}

TEST(ErrorSums, MatchWrittenOutFormula) {
  constexpr std::int32_t kSide = 8;
  const contract::Pass pass{0, 8};
  const FilmBlock block = made_block(whole_tile(kSide), 0, 0, pass);
  TileSum tile(kSide, kSide, 0);
  ASSERT_TRUE(tile.add(block, pass).ok());
  const double m = 0.7;
  BruteForce expected;
  std::vector<long double> per_pixel_expected;
  for (std::size_t pixel = 0; pixel < std::size_t{kSide} * kSide; ++pixel) {
    long double scaled = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      std::vector<long double> x;
      for (std::size_t r = 0; r < kReplicates; ++r) {
        x.push_back(block.rgb[pixel * 3 * kReplicates + 3 * r + c] / 2.0L);
      }
      const BruteForce one = brute_force(x, m);
      expected.squared += one.squared;
      expected.relative += one.relative;
      scaled += one.scaled;
    }
    expected.scaled += scaled;
    per_pixel_expected.push_back(scaled);
  }
  std::vector<double> per_pixel;
  const ErrorSums sums = tile.error_sums(m, &per_pixel);
  EXPECT_EQ(sums.pixels, kSide * kSide);
  EXPECT_NEAR(sums.squared, static_cast<double>(expected.squared), 1e-12);
  EXPECT_NEAR(sums.relative, static_cast<double>(expected.relative), 1e-12);
  EXPECT_NEAR(sums.scaled, static_cast<double>(expected.scaled), 1e-12);
  ASSERT_EQ(per_pixel.size(), per_pixel_expected.size());
  for (std::size_t i = 0; i < per_pixel.size(); ++i) {
    EXPECT_NEAR(per_pixel[i], static_cast<double>(per_pixel_expected[i]), 1e-13);
  }
}

TEST(ErrorSums, BatchMatchesSinglePixels) {
  // Whole tiles are processed in groups of pixels; one dropped sample makes it pixel by pixel.
  const contract::Pass pass{0, 8};
  const contract::PixelRect rect{0, 0, 7, 5};  // leaves a remainder of three
  FilmBlock block = made_block(rect, 0, 0, pass);
  TileSum together(7, 5, 0), alone(7, 5, 0);
  ASSERT_TRUE(together.add(block, pass).ok());
  block.dropped = {{34, 0, 1}};
  ASSERT_TRUE(alone.add(block, pass).ok());
  for (const double m : {0.0, 0.5}) {
    std::vector<double> a, b;
    const ErrorSums sums_a = together.error_sums(m, &a), sums_b = alone.error_sums(m, &b);
    ASSERT_EQ(a.size(), 35u);
    ASSERT_EQ(b.size(), 35u);
    for (std::size_t i = 0; i < 34; ++i) ASSERT_NEAR(a[i], b[i], 1e-13) << i << ", m " << m;
    EXPECT_NE(sums_a.relative, sums_b.relative) << "the last pixel differs";
    EXPECT_EQ(m == 0, sums_a.scaled == 0);
  }
}

TEST(ErrorSums, AreKeptUntilTheNextPass) {
  const contract::Pass first{0, 8}, second{8, 8};
  const contract::PixelRect rect = whole_tile(16);
  TileSum tile(16, 16, 0);
  ASSERT_TRUE(tile.add(made_block(rect, 0, 0, first), first).ok());
  EXPECT_EQ(tile.measured(0.5), nullptr);
  std::vector<double> per_pixel;
  const ErrorSums sums = tile.error_sums(0.5, &per_pixel);
  EXPECT_EQ(tile.measure(0.5).scaled, sums.scaled);
  const TileSum copy = tile;
  ASSERT_NE(copy.measured(0.5), nullptr);
  EXPECT_EQ(copy.measured(0.5)->sums.cautious, sums.cautious);
  std::sort(per_pixel.rbegin(), per_pixel.rend());
  per_pixel.resize(TileSum::Measured::kLargest);
  std::vector<double> largest = copy.measured(0.5)->largest;
  EXPECT_EQ(largest.front(), per_pixel.back());
  std::sort(largest.rbegin(), largest.rend());
  EXPECT_EQ(largest, per_pixel);
  EXPECT_EQ(tile.measured(0.25), nullptr);
  ASSERT_TRUE(tile.add(made_block(rect, 0, 1, second), second).ok());
  EXPECT_EQ(tile.measured(0.5), nullptr);
}

TEST(ErrorSums, NearlyEqualReplicatesDoNotCancel) {
  // Hard case 68: 1000 ± 0.1. Σ(x − x̄)² / (4·3) of {1000.1, 999.9, 1000.1, 999.9} = 0.04 / 12.
  TileSum tile(1, 1, 0);
  ASSERT_TRUE(tile.add(one_pixel({1000.1f, 999.9f, 1000.1f, 999.9f}, 4, true), {0, 4}).ok());
  EXPECT_NEAR(tile.error_sums(1).squared, 0.04 / 12, 0.04 / 12 * 0.01);
}

TEST(ErrorSums, FireflyIsNotInItsOwnDenominator) {
  // The denominator of its own term is 0.01 m² alone: (0.75 x)² / 0.01 / 12; also for a value so
  // bright that subtracting it from the total would leave rounding errors.
  for (const float x : {1e4f, 1e30f}) {
    TileSum alone(1, 1, 0), among(8, 1, 0);
    ASSERT_TRUE(alone.add(one_pixel({x, 0, 0, 0}, 4, true), {0, 4}).ok());
    FilmBlock block = FilmBlock::zeros({8, 1, 0, true});
    block.rgb[0] = x;
    ASSERT_TRUE(among.add(block, {0, 4}).ok());
    const double own = 0.75 * double{x} * 0.75 * double{x} / 0.01 / 12;
    EXPECT_GT(alone.error_sums(1).scaled, own * (1 - 1e-12));
    EXPECT_GT(among.error_sums(1).scaled, own * (1 - 1e-12));
  }
}

TEST(ErrorSums, RareBrightReplicatesAreNotTrusted) {
  // Three of four replicates met a bright reflection once. Their mean may be as wrong as the pixel,
  // so the darkest replicate is the divisor of their terms: (1/4 x)² / 0.01 / 12 each.
  constexpr float kBright = 100;
  TileSum alone(1, 1, 0), among(8, 1, 0);
  ASSERT_TRUE(alone.add(one_pixel({kBright, kBright, kBright, 0}, 4, true), {0, 4}).ok());
  FilmBlock block = FilmBlock::zeros({8, 1, 0, true});
  for (std::size_t r = 0; r < 3; ++r) block.rgb[3 * r] = kBright;
  ASSERT_TRUE(among.add(block, {0, 4}).ok());
  const double bright = 3 * 25.0 * 25.0 / 0.01 / 12, dark = 75.0 * 75.0 / (1e4 + 0.01) / 12;
  EXPECT_LT(alone.error_sums(1).scaled, 0.1 * 3) << "the estimate itself stays";
  EXPECT_NEAR(alone.error_sums(1).cautious, bright + dark, 1e-6);
  EXPECT_NEAR(among.error_sums(1).cautious, bright + dark, 1e-6);
  // A replicate that is dark by a factor of 22 is noise.
  TileSum noisy(1, 1, 0);
  ASSERT_TRUE(noisy.add(one_pixel({kBright, kBright, kBright, 3}, 4, true), {0, 4}).ok());
  EXPECT_EQ(noisy.error_sums(1).cautious, noisy.error_sums(1).scaled);
}

TEST(ErrorSums, BlackFrameHasZeroError) {
  TileSum tile(1, 1, 0);
  ASSERT_TRUE(tile.add(one_pixel({0, 0, 0, 0}, 4, true), {0, 4}).ok());
  const ErrorEstimate estimate = estimate_error(tile.error_sums(0));
  EXPECT_EQ(estimate.error, 0);
  EXPECT_EQ(estimate.relmse, 0);
  EXPECT_EQ(estimate.n_eff, 0);
  EXPECT_EQ(estimate.pixels, 1);
}

TEST(ErrorEstimate, KnownSumsGiveKnownFigures) {
  // Four pixels with scaled sums 3, 3, 3, 6 over three channels each.
  ErrorSums sums;
  sums.pixels = 4;
  sums.squared = 48;
  sums.relative = 6;
  sums.scaled = sums.cautious = 15;
  sums.cautious_squares = 9 + 9 + 9 + 36;
  const ErrorEstimate estimate = estimate_error(sums);
  EXPECT_DOUBLE_EQ(estimate.rmse, 2);
  EXPECT_DOUBLE_EQ(estimate.relmse, 0.5);
  EXPECT_DOUBLE_EQ(estimate.error, std::sqrt(1.25));
  EXPECT_DOUBLE_EQ(estimate.n_eff, 225.0 / 63);
  // Means over channels 1, 1, 1, 2: sample deviation 0.5, standard error 0.25, times √4 replicates.
  const double x = 1.644853627 * 0.25 / 1.25;
  EXPECT_NEAR(estimate.error_upper95, std::sqrt(1.25 * (1 + 2 * x / (1 - x / 2))), 1e-9);
}

TEST(ErrorEstimate, IsUnbiasedForNormalNoise) {
  // Normal noise of known variance on a grey tile: the pooled estimate is within 5 standard errors
  // of the truth (the variance of an R = 4 variance estimate is 2σ⁴/3 per value).
  constexpr std::int32_t kSide = 64;
  std::mt19937 rng(7);
  std::normal_distribution<double> noise(0, 0.1);
  FilmBlock block = FilmBlock::zeros({kSide, kSide, 0, true});
  for (float& value : block.rgb) value = static_cast<float>(1 + noise(rng));
  TileSum tile(kSide, kSide, 0);
  ASSERT_TRUE(tile.add(block, {0, 4}).ok());
  const ErrorEstimate estimate = estimate_error(tile.error_sums(1));
  const double truth = 0.01 / 4, values = 3.0 * kSide * kSide;
  EXPECT_NEAR(estimate.rmse * estimate.rmse, truth, 5 * truth * std::sqrt(2.0 / 3 / values));
}

TEST(TileSum, LuminanceUsesMeans) {
  FilmBlock block = FilmBlock::zeros({1, 1, 0, true});
  for (std::size_t r = 0; r < kReplicates; ++r) {
    block.rgb[3 * r] = 1;
    block.rgb[3 * r + 1] = 2;
    block.rgb[3 * r + 2] = 3;
  }
  TileSum tile(1, 1, 0);
  ASSERT_TRUE(tile.add(block, {0, 4}).ok());
  EXPECT_NEAR(tile.luminance_sum(), 0.2126 + 2 * 0.7152 + 3 * 0.0722, 1e-15);
}

}  // namespace
}  // namespace tessera::server
