#include "contract/pass_schedule.h"

#include <gtest/gtest.h>

#include <limits>

#include "contract/render_settings.h"
#include "contract/version.h"

namespace tessera::contract {
namespace {

TEST(PassSchedule, PassesAreContiguousUpToRoundedCount) {
  for (std::int32_t spp = 1; spp <= 5000; ++spp) {
    const std::vector<Pass> passes = fixed_schedule(spp);
    std::int32_t next = 0;
    for (const Pass& pass : passes) {
      ASSERT_EQ(pass.first_sample, next) << "spp " << spp;
      ASSERT_GE(pass.sample_count, 1) << "spp " << spp;
      ASSERT_EQ(pass.sample_count % kReplicates, 0) << "spp " << spp;
      next += pass.sample_count;
    }
    ASSERT_EQ(next, rounded_spp(spp)) << "spp " << spp;
    ASSERT_GE(next, spp);
    ASSERT_LT(next - spp, kReplicates);
  }
}

TEST(PassSchedule, FixedScheduleIsSmallThenLarge) {
  EXPECT_EQ(fixed_schedule(1), (std::vector<Pass>{{0, 4}}));
  EXPECT_EQ(fixed_schedule(8), (std::vector<Pass>{{0, 8}}));
  EXPECT_EQ(fixed_schedule(64), (std::vector<Pass>{{0, 8}, {8, 56}}));
  EXPECT_EQ(fixed_schedule(512), (std::vector<Pass>{{0, 8}, {8, 56}, {64, 448}}));
  EXPECT_EQ(fixed_schedule(1500),
            (std::vector<Pass>{{0, 8}, {8, 56}, {64, 448}, {512, 512}, {1024, 476}}));
}

TEST(PassSchedule, ExtensionKeepsAllButLastPass) {
  for (std::int32_t spp = 1; spp <= 1200; spp += 7) {
    for (std::int32_t more = spp + 1; more <= 1300; more += 113) {
      const std::vector<Pass> before = fixed_schedule(spp), after = fixed_schedule(more);
      ASSERT_GE(after.size(), before.size());
      for (std::size_t i = 0; i + 1 < before.size(); ++i) ASSERT_EQ(before[i], after[i]);
      ASSERT_EQ(before.back().first_sample, after[before.size() - 1].first_sample);
    }
  }
}

TEST(PassSchedule, MaximumSppIsReached) {
  const std::vector<Pass> passes = fixed_schedule(kMaxSpp);
  EXPECT_EQ(passes.back().first_sample + passes.back().sample_count, kMaxSpp);
}

TEST(FrameList, IsSortedAndUnique) {
  EXPECT_EQ(frame_list({{4, 4, 1}, {1, 5, 2}, {9, 9, 1}, {5, 6, 1}}),
            (std::vector<std::int32_t>{1, 3, 4, 5, 6, 9}));
  EXPECT_EQ(frame_list({{0, 0, 1}}), (std::vector<std::int32_t>{0}));
}

TEST(FrameList, LastFrameDoesNotOverflow) {
  constexpr std::int32_t kLast = std::numeric_limits<std::int32_t>::max();
  EXPECT_EQ(frame_list({{kLast - 3, kLast, 2}}), (std::vector<std::int32_t>{kLast - 3, kLast - 1}));
}

TEST(FrameCount, LargeRangesDoNotOverflow) {
  constexpr std::int32_t kLast = std::numeric_limits<std::int32_t>::max();
  EXPECT_EQ(frame_count({{0, kLast, 1}, {0, kLast, 1}}), 2 * (std::int64_t{kLast} + 1));
  EXPECT_EQ(frame_count({{1, 10, 2}}), 5);
  EXPECT_EQ(frame_count({{1, 9, 2}, {3, 3, 7}}), 6);
}

TEST(PassSchedule, ErrorScheduleDoublesTotals) {
  EXPECT_EQ(error_schedule(4), (std::vector<Pass>{{0, 4}}));
  EXPECT_EQ(error_schedule(20), (std::vector<Pass>{{0, 8}, {8, 12}}));
  EXPECT_EQ(error_schedule(200),
            (std::vector<Pass>{{0, 8}, {8, 24}, {32, 32}, {64, 64}, {128, 72}}));
  std::vector<std::int32_t> totals;
  for (const Pass& pass : error_schedule(3500)) totals.push_back(pass.end());
  EXPECT_EQ(totals, (std::vector<std::int32_t>{8, 32, 64, 128, 256, 512, 768, 1024, 1536, 2048,
                                               3072, 3500}));
  for (const std::int32_t max_spp : {1, 33, 1000, 16384, kMaxSpp}) {
    std::int32_t next = 0;
    for (const Pass& pass : error_schedule(max_spp)) {
      ASSERT_EQ(pass.first_sample, next);
      ASSERT_EQ(pass.sample_count % kReplicates, 0);
      next += pass.sample_count;
    }
    EXPECT_EQ(next, rounded_spp(max_spp));
  }
  EXPECT_LE(error_schedule(kMaxSpp).size(), 32u) << "the table of quantiles ends there";
}

}  // namespace
}  // namespace tessera::contract
