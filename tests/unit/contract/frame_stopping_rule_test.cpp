#include "contract/frame_stopping_rule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <utility>
#include <vector>

namespace tessera::contract {
namespace {

constexpr std::int64_t kFewPixels = 64;
constexpr ErrorSums kNoisy{kFewPixels, 1, 1, 1, 1}, kNoiseless{kFewPixels, 0, 0, 0, 0};

FrameStoppingRule make_rule(std::size_t tiles, std::int32_t max_spp = 256, double error = 0.1) {
  return {error, error_schedule(max_spp), std::vector<std::int64_t>(tiles, kFewPixels)};
}

/// Adds all passes up to the tiles' targets, shuffled by `seed`.
void render(FrameStoppingRule& rule, std::int32_t tiles, std::uint32_t seed) {
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
  for (const auto& [tile, pass] : units) rule.add(tile, pass, kNoisy);
}

TEST(FrameStoppingRule, LookWaitsForTheLastTile) {
  FrameStoppingRule rule = make_rule(3);
  for (std::int32_t tile = 0; tile < 3; ++tile) {
    rule.add(tile, 0, kNoisy);
    EXPECT_FALSE(rule.due_look());
  }
  rule.add(2, 1, kNoisy);
  rule.add(0, 1, kNoisy);
  EXPECT_FALSE(rule.due_look());
  rule.add(1, 1, kNoisy);
  EXPECT_EQ(rule.due_look(), 1);
  EXPECT_TRUE(rule.take_changes().empty()) << "no tile continues before the look";
}

TEST(FrameStoppingRule, FrameThatMeetsBoundStops) {
  FrameStoppingRule rule = make_rule(2);
  render(rule, 2, 1);
  rule.end_look(true, 0.05);
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

TEST(FrameStoppingRule, AllTilesContinueIfBoundIsNotMet) {
  FrameStoppingRule rule = make_rule(2);
  render(rule, 2, 1);
  rule.end_look(false, 0.2);
  const auto changes = rule.take_changes();
  ASSERT_EQ(changes.size(), 2u);
  for (const PassRule::PassTarget& change : changes) {
    EXPECT_FALSE(change.is_final);
    EXPECT_EQ(change.pass_count, 3);
  }
  EXPECT_EQ(rule.expected_samples(), 2 * kFewPixels * 32 * 4) << "a fourth of the squared error";
  rule.end_look(true, 0.05);
  EXPECT_EQ(rule.pass_count(0), 3) << "a look that is not due is ignored";
}

TEST(FrameStoppingRule, TileWithoutNoiseStopsAfterPassOne) {
  FrameStoppingRule rule = make_rule(2);
  for (std::int32_t pass = 0; pass < 2; ++pass) {
    rule.add(0, pass, kNoiseless);
    rule.add(1, pass, kNoisy);
  }
  EXPECT_EQ(rule.due_look(), 1);
  rule.end_look(false, 0.2);
  EXPECT_EQ(rule.pass_count(0), 2);
  EXPECT_EQ(rule.pass_count(1), 3);
  rule.add(1, 2, kNoisy);
  EXPECT_EQ(rule.due_look(), 2);
}

TEST(FrameStoppingRule, TilesStopAtTheLastPassWithoutLook) {
  FrameStoppingRule rule = make_rule(2, 64);
  render(rule, 2, 1);
  rule.end_look(false, 0.2);
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
  const auto targets = [](std::uint32_t seed, int copies) {
    FrameStoppingRule rule = make_rule(5);
    std::vector<std::int32_t> counts;
    for (std::int32_t look = 0; look < 3; ++look) {
      for (int copy = 0; copy < copies; ++copy)
        render(rule, 5, seed + static_cast<std::uint32_t>(look));
      counts.push_back(rule.due_look().value_or(-1));
      rule.end_look(look == 2, 0.2);
      for (std::int32_t tile = 0; tile < 5; ++tile) counts.push_back(rule.pass_count(tile));
    }
    return counts;
  };
  const std::vector<std::int32_t> expected = targets(1, 1);
  EXPECT_EQ(expected.front(), 1);
  EXPECT_EQ(expected.back(), 4);
  EXPECT_EQ(targets(7, 1), expected);
  EXPECT_EQ(targets(9, 2), expected);
}

}  // namespace
}  // namespace tessera::contract
