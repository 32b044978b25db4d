#include "contract/stopping/frame_stopping_rule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <utility>
#include <vector>

namespace tessera::contract {
namespace {

constexpr std::int64_t kFewPixels = 64;
constexpr ErrorSums kNoiseless{kFewPixels};
constexpr double kError = 0.1;  // the target E

/// Sums of a tile whose cautious error is `square`, spread evenly over its pixels.
constexpr ErrorSums noise(double square) {
  ErrorSums sums{kFewPixels};
  sums.cautious = square;
  sums.cautious_squares = square * square / kFewPixels;
  return sums;
}
constexpr ErrorSums kNoisy = noise(1);

using LookResult = FrameStoppingRule::LookResult;
constexpr LookResult kMet{0.04, 0.05};
constexpr LookResult kMissed{0.1, 0.12};  // in reach with another pass of some tiles
constexpr LookResult kOutOfReach{5, 6};   // by any schedule here

/// Passes end at 8, 32, 64, 128, 256, 512, 768, … samples.
FrameStoppingRule make_rule(std::size_t tiles, std::int32_t max_spp = 256) {
  return {kError, error_schedule(max_spp), std::vector<std::int64_t>(tiles, kFewPixels)};
}

/// Adds passes 0 and 1 of tiles with these errors after pass 1.
void start(FrameStoppingRule& rule, const std::vector<double>& squares) {
  for (std::size_t tile = 0; tile < squares.size(); ++tile) {
    for (std::int32_t pass = 0; pass < 2; ++pass)
      rule.add(static_cast<std::int32_t>(tile), pass, noise(squares[tile]));
  }
}

std::vector<std::int32_t> pass_counts(const FrameStoppingRule& rule, std::int32_t tiles) {
  std::vector<std::int32_t> counts;
  for (std::int32_t tile = 0; tile < tiles; ++tile) counts.push_back(rule.pass_count(tile));
  return counts;
}

/// Sums of a tile after a pass.
using Noise = std::function<ErrorSums(std::int32_t tile, std::int32_t pass)>;

/// Adds all passes up to the tiles' targets, shuffled by `seed`.
void render(
    FrameStoppingRule& rule, std::int32_t tiles, std::uint32_t seed,
    const Noise& sums = [](std::int32_t, std::int32_t) { return kNoisy; }) {
  std::vector<std::pair<std::int32_t, std::int32_t>> units;
  for (std::int32_t tile = 0; tile < tiles; ++tile) {
    for (std::int32_t pass = 0; pass < rule.pass_count(tile); ++pass)
      units.emplace_back(tile, pass);
  }
  std::mt19937 random(seed);
  std::shuffle(units.begin(), units.end(), random);
  // A tile's passes count in order.
  std::stable_sort(units.begin(), units.end(),
                   [](const auto& a, const auto& b) { return a.second < b.second; });
  for (const auto& [tile, pass] : units) rule.add(tile, pass, sums(tile, pass));
}

TEST(FrameStoppingRule, LookWaitsForTheLastTile) {
  FrameStoppingRule rule = make_rule(3);
  for (std::int32_t tile = 0; tile < 3; ++tile) {
    rule.add(tile, 0, kNoisy);
    EXPECT_FALSE(rule.due_look());
  }
  rule.add(2, 1, kNoisy);
  rule.add(2, 1, kNoisy);  // a repetition is ignored
  rule.add(0, 1, kNoisy);
  EXPECT_FALSE(rule.due_look());
  rule.add(1, 1, kNoisy);
  EXPECT_EQ(rule.due_look(), 1);
  EXPECT_TRUE(rule.take_changes().empty()) << "no tile continues before the look";
}

TEST(FrameStoppingRule, FrameThatMeetsBoundStops) {
  FrameStoppingRule rule = make_rule(2);
  render(rule, 2, 1);
  rule.end_look(kMet);
  const auto changes = rule.take_changes();
  ASSERT_EQ(changes.size(), 2u);
  for (const PassRule::PassTarget& change : changes) {
    EXPECT_TRUE(change.is_final);
    EXPECT_EQ(change.pass_count, 2);
  }
  EXPECT_FALSE(rule.due_look());
  EXPECT_EQ(rule.capped_tile_count(), 0);
  EXPECT_EQ(rule.expected_samples(), 2 * kFewPixels * 32);
}

TEST(FrameStoppingRule, QuietTileWaitsWhileNoisyOneContinues) {
  FrameStoppingRule rule = make_rule(2);
  start(rule, {1, 9});
  rule.end_look(kMissed);
  // With 64 samples in tile 1: 0.01 · 5.5 / 10 + 0.0044 · √(21.25 / 82) = 0.0077 <= 0.009.
  const auto changes = rule.take_changes();
  ASSERT_EQ(changes.size(), 1u);
  EXPECT_EQ(changes[0].tile, 1);
  EXPECT_EQ(changes[0].pass_count, 3);
  EXPECT_FALSE(changes[0].is_final);
  EXPECT_EQ(rule.expected_samples(), kFewPixels * (32 + 64));
  EXPECT_FALSE(rule.due_look());
  rule.add(1, 2, noise(4.5));
  EXPECT_EQ(rule.due_look(), 2);
  rule.end_look(kMet);
  EXPECT_EQ(rule.take_changes().size(), 2u) << "both tiles stop";
  EXPECT_EQ(rule.expected_samples(), kFewPixels * (32 + 64));
}

TEST(FrameStoppingRule, LookThatIsNotDueIsIgnored) {
  FrameStoppingRule rule = make_rule(2);
  start(rule, {1, 1});
  rule.end_look(kOutOfReach);
  rule.end_look(kMet);
  for (const PassRule::PassTarget& change : rule.take_changes()) EXPECT_FALSE(change.is_final);
  rule.add(0, 2, kNoisy);
  rule.add(1, 2, kNoisy);
  EXPECT_EQ(rule.due_look(), 2);
}

TEST(FrameStoppingRule, WaitingTileContinuesAtLaterLook) {
  FrameStoppingRule rule = make_rule(2, 4096);
  start(rule, {1, 9});
  rule.end_look(kMissed);
  rule.add(1, 2, noise(4.5));
  rule.end_look(kMissed);
  ASSERT_EQ(pass_counts(rule, 2), (std::vector<std::int32_t>{2, 4}));
  rule.add(1, 3, noise(0.001));  // better than predicted: tile 0 has most of the error now
  ASSERT_EQ(rule.due_look(), 3);
  rule.take_changes();
  rule.end_look({0.4, 0.5});
  const auto changes = rule.take_changes();
  ASSERT_EQ(changes.size(), 1u);
  EXPECT_EQ(changes[0].tile, 0);
  EXPECT_EQ(changes[0].pass_count, 5) << "up to the pass after the look";
}

TEST(FrameStoppingRule, AllTilesContinueIfNoPlanMeetsBound) {
  FrameStoppingRule rule = make_rule(2);
  start(rule, {1, 9});
  rule.end_look(kOutOfReach);
  EXPECT_EQ(pass_counts(rule, 2), (std::vector<std::int32_t>{3, 3}));
  EXPECT_EQ(rule.expected_samples(), 2 * kFewPixels * 256);
  rule.add(0, 2, kNoisy);
  rule.add(1, 2, kNoisy);
  rule.end_look(kMet);
  EXPECT_EQ(rule.expected_samples(), 2 * kFewPixels * 64) << "earlier than expected";
}

TEST(FrameStoppingRule, AllStopIfTargetIsOutOfReach) {
  for (const bool is_concentrated : {false, true}) {
    FrameStoppingRule rule = make_rule(2, 1024);
    start(rule, {1, 9});
    const double bound = 4.1 * kError;  // with 256 of 1,024 samples more than fourfold is too much
    for (std::int32_t pass = 2; pass <= 4; ++pass) {
      rule.end_look({kError, 100 * kError, is_concentrated});
      EXPECT_FALSE(rule.is_futile()) << "pass " << pass;
      for (std::int32_t tile = 0; tile < 2; ++tile) rule.add(tile, pass, kNoisy);
    }
    ASSERT_EQ(rule.due_look(), 4);
    FrameStoppingRule near = rule;
    near.end_look({kError, 3.9 * kError, is_concentrated});
    EXPECT_FALSE(near.is_futile());
    rule.end_look({kError, bound, is_concentrated});
    EXPECT_EQ(rule.is_futile(), is_concentrated);
    EXPECT_FALSE(rule.due_look());
    const std::int32_t passes = is_concentrated ? 5 : 6;
    EXPECT_EQ(pass_counts(rule, 2), (std::vector<std::int32_t>{passes, passes}));
  }
}

TEST(FrameStoppingRule, AllTilesGetLastPassAfterLastLook) {
  FrameStoppingRule rule = make_rule(2, 128);
  start(rule, {1, 9});
  rule.end_look(kMissed);
  ASSERT_EQ(pass_counts(rule, 2), (std::vector<std::int32_t>{2, 3}));
  rule.add(1, 2, noise(4.5));
  ASSERT_EQ(rule.due_look(), 2);
  rule.end_look(kMissed);
  EXPECT_EQ(pass_counts(rule, 2), (std::vector<std::int32_t>{4, 4}));
  rule.add(0, 2, noise(0.5));
  rule.add(0, 3, noise(0.3));
  rule.add(1, 3, noise(2));
  EXPECT_FALSE(rule.due_look());
  EXPECT_EQ(rule.capped_tile_count(), 2);
}

/// The plan as an exhaustive search over all levels at which a tile's plan changes.
std::vector<std::int32_t> planned_passes(const std::vector<ErrorSums>& sums,
                                         const std::vector<Pass>& passes, const LookResult& look) {
  const auto n = [&](std::size_t pass) { return static_cast<double>(passes[pass].end()); };
  const double square = look.error * look.error, rest = look.bound * look.bound - square;
  ErrorSums frame;
  for (const ErrorSums& tile : sums) frame.add(tile);
  const auto worth = [&](const ErrorSums& tile, std::size_t pass) {
    return (square * tile.cautious / frame.cautious +
            rest * tile.cautious_squares / frame.cautious_squares) *
           n(1) / kFewPixels / (n(pass) * n(pass));
  };
  std::vector<double> levels;
  for (const ErrorSums& tile : sums) {
    for (std::size_t pass = 1; pass < passes.size(); ++pass) levels.push_back(worth(tile, pass));
  }
  std::sort(levels.rbegin(), levels.rend());
  for (const double level : levels) {
    std::vector<std::int32_t> ends;
    ErrorSums later;
    for (const ErrorSums& tile : sums) {
      std::size_t end = 1;
      while (end + 1 < passes.size() && worth(tile, end) > level * (1 + 1e-12)) ++end;
      later.add(tile.scaled_by(n(1) / n(end)));
      ends.push_back(static_cast<std::int32_t>(end));
    }
    const double predicted = square * later.cautious / frame.cautious +
                             rest * std::sqrt(later.cautious_squares / frame.cautious_squares);
    if (predicted <= 0.9 * kError * kError) return ends;
  }
  return {};
}

TEST(FrameStoppingRule, PlanEqualsExhaustiveSearch) {
  std::mt19937 random(5);
  const auto u01 = [&] { return static_cast<double>(random()) * 0x1p-32; };
  const std::vector<Pass> passes = error_schedule(4096);
  constexpr std::int32_t kTiles = 12;
  int waiting = 0, planned = 0;
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<ErrorSums> sums;
    for (std::int32_t tile = 0; tile < kTiles; ++tile) {
      sums.push_back(noise(std::exp(8 * u01())));
      sums.back().cautious_squares *= 1 + 30 * u01();
    }
    const double error = 0.05 + 0.2 * u01();
    const LookResult look{error, std::max(error, kError) * (1.01 + u01())};
    FrameStoppingRule rule = make_rule(kTiles, 4096);
    render(rule, kTiles, 1,
           [&](std::int32_t tile, std::int32_t) { return sums[static_cast<std::size_t>(tile)]; });
    rule.end_look(look);
    const std::vector<std::int32_t> ends = planned_passes(sums, passes, look);
    ASSERT_FALSE(ends.empty()) << "trial " << trial;
    std::int64_t samples = 0;
    for (std::int32_t tile = 0; tile < kTiles; ++tile) {
      const std::int32_t end = ends[static_cast<std::size_t>(tile)];
      EXPECT_EQ(rule.pass_count(tile), std::min(end, 2) + 1)
          << "trial " << trial << ", tile " << tile;
      samples += kFewPixels * passes[static_cast<std::size_t>(end)].end();
      ++(end == 1 ? waiting : planned);
    }
    EXPECT_EQ(rule.expected_samples(), samples) << "trial " << trial;
  }
  EXPECT_GT(waiting, 200) << "the test needs tiles that wait";
  EXPECT_GT(planned, 200) << "the test needs tiles that continue";
}

TEST(FrameStoppingRule, TileWithoutNoiseStopsAfterPassOne) {
  FrameStoppingRule rule = make_rule(2);
  for (std::int32_t pass = 0; pass < 2; ++pass) {
    rule.add(0, pass, kNoiseless);
    rule.add(1, pass, kNoisy);
  }
  EXPECT_EQ(rule.due_look(), 1);
  rule.end_look(kOutOfReach);
  EXPECT_EQ(rule.pass_count(0), 2);
  EXPECT_EQ(rule.pass_count(1), 3);
  rule.add(1, 2, kNoisy);
  EXPECT_EQ(rule.due_look(), 2);
}

TEST(FrameStoppingRule, TilesStopAtTheLastPassWithoutLook) {
  FrameStoppingRule rule = make_rule(2, 64);
  render(rule, 2, 1);
  rule.end_look(kMissed);
  render(rule, 2, 2);
  EXPECT_FALSE(rule.due_look());
  EXPECT_EQ(rule.capped_tile_count(), 2);
  EXPECT_EQ(rule.looks(), 2);
}

TEST(FrameStoppingRule, ScheduleOfOnePassEndsThere) {
  FrameStoppingRule rule = make_rule(1, 8);
  rule.add(0, 0, kNoisy);
  EXPECT_FALSE(rule.due_look());
  const auto changes = rule.take_changes();
  ASSERT_EQ(changes.size(), 1u);
  EXPECT_TRUE(changes[0].is_final);
  EXPECT_EQ(changes[0].pass_count, 1);
}

TEST(FrameStoppingRule, OrderAndRepetitionsDoNotMatter) {
  constexpr std::int32_t kTiles = 5;
  const Noise sums = [](std::int32_t tile, std::int32_t pass) {
    return noise(std::ldexp(1 + tile * tile, -pass) / 3);
  };
  const auto targets = [&](std::uint32_t seed, int copies) {
    FrameStoppingRule rule = make_rule(kTiles, 4096);
    std::vector<std::int32_t> counts;
    for (std::int32_t look = 0; look < 4; ++look) {
      for (int copy = 0; copy < copies; ++copy)
        render(rule, kTiles, seed + static_cast<std::uint32_t>(look), sums);
      counts.push_back(rule.due_look().value_or(-1));
      rule.end_look(look == 3 ? kMet : kMissed);
      for (const std::int32_t count : pass_counts(rule, kTiles)) counts.push_back(count);
    }
    return counts;
  };
  const std::vector<std::int32_t> expected = targets(1, 1);
  EXPECT_EQ(expected.front(), 1);
  EXPECT_LT(expected[expected.size() - kTiles], expected.back()) << "tiles with different targets";
  for (std::uint32_t seed = 2; seed < 20; ++seed) {
    EXPECT_EQ(targets(seed, 1), expected) << "seed " << seed;
    EXPECT_EQ(targets(seed, 2), expected) << "seed " << seed;
  }
}

}  // namespace
}  // namespace tessera::contract
