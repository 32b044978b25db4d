#include "server/schedule/plan/job_plan.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace tessera::server {
namespace {

using contract::Pass;
using contract::Unit;

const auto any_unit = [](const Unit&) { return true; };

JobPlan plan_of(std::vector<std::int32_t> frames, std::int32_t tiles, int passes) {
  std::vector<Pass> schedule;
  for (int i = 0; i < passes; ++i) schedule.push_back({8 * i, 8});
  return JobPlan(std::move(frames), tiles, schedule);
}

/// Leases the next run to `worker`.
std::vector<Unit> take(JobPlan& plan, WorkerKey worker, std::int32_t max_tiles) {
  const auto run = plan.next_run(max_tiles, any_unit);
  std::vector<Unit> units;
  if (!run) return units;
  for (std::int32_t i = 0; i < run->tile_count; ++i) {
    units.push_back({run->frame, run->first_tile + i, run->pass});
    plan.hold(units.back(), Holder{worker, {}, std::nullopt, false, 0});
  }
  return units;
}

TEST(JobPlan, LeasesByFramePassAndCurve) {
  JobPlan plan = plan_of({3, 7}, 3, 2);
  std::vector<Unit> order;
  for (auto units = take(plan, 1, 1); !units.empty(); units = take(plan, 1, 1)) {
    order.push_back(units.front());
  }
  std::vector<Unit> expected;
  for (const std::int32_t frame : {3, 7}) {
    for (const std::int32_t pass : {0, 1}) {
      for (const std::int32_t tile : {0, 1, 2}) expected.push_back({frame, tile, pass});
    }
  }
  EXPECT_EQ(order, expected);
  EXPECT_EQ(plan.counts().waiting, 0);
}

TEST(JobPlan, RunStaysWithinOnePass) {
  JobPlan plan = plan_of({0}, 5, 2);
  EXPECT_EQ(take(plan, 1, 3).size(), 3u);
  EXPECT_EQ(take(plan, 1, 3).size(), 2u);
  EXPECT_EQ(take(plan, 1, 9).size(), 5u);
}

TEST(JobPlan, ReturnedUnitsAreLeasedFirst) {
  JobPlan plan = plan_of({0}, 4, 2);
  const auto first = take(plan, 1, 2);
  ASSERT_TRUE(plan.release(first[1], 1));
  EXPECT_EQ(take(plan, 2, 1).front(), first[1]);
  EXPECT_EQ(take(plan, 2, 1).front(), (Unit{0, 2, 0}));
}

TEST(JobPlan, UnitWaitsOnlyAfterBothHoldersReleaseIt) {
  JobPlan plan = plan_of({0}, 1, 1);
  const Unit unit = take(plan, 1, 1).front();
  plan.hold(unit, Holder{2, {}, std::nullopt, false, 0});
  EXPECT_TRUE(plan.release(unit, 1));
  EXPECT_EQ(plan.counts().waiting, 0);
  EXPECT_FALSE(plan.release(unit, 1)) << "the worker no longer holds it";
  EXPECT_TRUE(plan.release(unit, 2));
  EXPECT_EQ(plan.counts().waiting, 1);
}

TEST(JobPlan, CommittedUnitsAreSkipped) {
  JobPlan plan = plan_of({0}, 4, 1);
  plan.commit({0, 0, 0});
  plan.commit({0, 2, 0});
  EXPECT_EQ(take(plan, 1, 9), (std::vector<Unit>{{0, 1, 0}}));
  EXPECT_EQ(take(plan, 1, 9), (std::vector<Unit>{{0, 3, 0}}));
}

TEST(JobPlan, FinishedFrameCountsAsCommitted) {
  JobPlan plan = plan_of({0, 1}, 2, 1);
  plan.commit({0, 0, 0});
  plan.finish(0);  // as after a restart: its blocks are gone
  EXPECT_TRUE(plan.is_committed({0, 1, 0}));
  EXPECT_EQ(plan.counts().committed, 2);
  EXPECT_EQ(take(plan, 1, 1).front(), (Unit{1, 0, 0}));
}

TEST(JobPlan, FinishingAgainOrAnotherFrameCountsNothing) {
  JobPlan plan = plan_of({0, 1}, 2, 1);
  plan.finish(0);
  plan.finish(0);
  plan.finish(7);  // not of this job
  EXPECT_EQ(plan.counts().committed, 2);
  EXPECT_EQ(plan.counts().planned, 4);
}

TEST(JobPlan, RefusedUnitIsKeptForOthers) {
  JobPlan plan = plan_of({0}, 2, 1);
  const auto not_the_first = [](const Unit& unit) { return unit.tile != 0; };
  EXPECT_EQ(plan.next_run(1, not_the_first)->first_tile, 1);
  EXPECT_EQ(plan.next_run(1, any_unit)->first_tile, 0);
}

TEST(JobPlan, ExtendingKeepsUnchangedPasses) {
  JobPlan plan({0}, 2, contract::fixed_schedule(32));  // 8, then 24
  for (const std::int32_t pass : {0, 1}) plan.commit({0, 0, pass});
  plan.hold({0, 1, 1}, Holder{1, {}, std::nullopt, false, 0});
  const auto gone = plan.extend(contract::fixed_schedule(64), false);  // 8, then 56
  ASSERT_EQ(gone.size(), 1u);
  EXPECT_EQ(gone.front().first, (Unit{0, 1, 1}));
  EXPECT_TRUE(plan.is_committed({0, 0, 0}));
  EXPECT_FALSE(plan.is_committed({0, 0, 1})) << "a pass that was cut short";
  EXPECT_EQ(plan.counts().committed, 1);
  EXPECT_EQ(take(plan, 1, 1).front(), (Unit{0, 1, 0}));
}

TEST(JobPlan, RandomOperationsLoseNoUnit) {  // checked against a model
  std::mt19937 random(7);
  JobPlan plan = plan_of({0, 1, 2}, 37, 3);
  std::set<Unit> held, committed;
  for (int step = 0; step < 20'000 && static_cast<int>(committed.size()) < 3 * 37 * 3; ++step) {
    if (random() % 2 == 0) {
      for (const Unit& unit : take(plan, 1, static_cast<std::int32_t>(random() % 5 + 1))) {
        ASSERT_EQ(committed.count(unit), 0u);
        ASSERT_TRUE(held.insert(unit).second) << "given twice";
      }
    } else if (!held.empty()) {
      auto unit = std::next(held.begin(), static_cast<std::ptrdiff_t>(random() % held.size()));
      if (random() % 3 == 0) {
        plan.release(*unit, 1);
      } else {
        plan.commit(*unit);
        committed.insert(*unit);
      }
      held.erase(unit);
    }
    ASSERT_EQ(plan.counts().in_flight, static_cast<std::int64_t>(held.size()));
    ASSERT_EQ(plan.counts().committed, static_cast<std::int64_t>(committed.size()));
  }
  EXPECT_EQ(committed.size(), 3u * 37 * 3);
  EXPECT_TRUE(plan.is_complete(0) && plan.is_complete(1) && plan.is_complete(2));
}

TEST(JobPlan, OnDemandStartsWithTwoPasses) {
  JobPlan plan({0, 1}, 3, contract::error_schedule(256), true);  // 5 passes
  EXPECT_EQ(plan.counts().planned, 12);
  EXPECT_EQ(take(plan, 1, 100).size(), 3u);
  const std::vector<Unit> pass1 = take(plan, 1, 100);
  plan.set_pass_target(0, 1, 3, false);
  EXPECT_EQ(plan.counts().planned, 13);
  const std::vector<Unit> asked = take(plan, 1, 100);
  EXPECT_EQ(asked, (std::vector<Unit>{{0, 1, 2}})) << "frame 0 before frame 1";
  EXPECT_EQ(take(plan, 1, 100).front(), (Unit{1, 0, 0}));
}

TEST(JobPlan, OnDemandFrameEndsWithLastTilePass) {
  JobPlan plan({0}, 2, contract::error_schedule(256), true);
  for (const std::int32_t pass : {0, 1}) {
    for (const std::int32_t tile : {0, 1}) plan.commit({0, tile, pass});
  }
  EXPECT_FALSE(plan.is_complete(0)) << "no decision yet";
  plan.set_pass_target(0, 0, 2, true);
  plan.set_pass_target(0, 1, 3, false);
  EXPECT_FALSE(plan.is_complete(0));
  plan.commit({0, 1, 2});
  EXPECT_FALSE(plan.is_complete(0)) << "tile 1 may need more passes";
  plan.set_pass_target(0, 1, 3, true);
  plan.set_pass_target(0, 1, 3, true);
  EXPECT_TRUE(plan.is_complete(0));
  EXPECT_EQ(plan.counts().committed, 5);
  EXPECT_EQ(plan.counts().waiting, 0);
  plan.finish(0);
  EXPECT_EQ(plan.counts().planned, 5);
  EXPECT_EQ(plan.counts().committed, 5);
}

TEST(JobPlan, OnDemandLeaseImpliesPassTarget) {
  JobPlan plan({0}, 2, contract::error_schedule(256), true);
  // After a restart a worker still holds a unit of pass 3 before the film has made a decision.
  plan.hold({0, 1, 3}, Holder{1, {}, std::nullopt, false, 0});
  EXPECT_EQ(plan.counts().planned, 6) << "4, and passes 2 and 3 of tile 1";
  EXPECT_EQ(plan.counts().in_flight, 1);
  plan.set_pass_target(0, 1, 4, false);
  EXPECT_EQ(plan.counts().planned, 6) << "known pass targets are not reported again";
  ASSERT_TRUE(plan.release({0, 1, 3}, 1));
  EXPECT_EQ(plan.counts().waiting, 6);
}

TEST(JobPlan, OnDemandFinishedFrameKeepsUnitCount) {
  JobPlan plan({0, 1}, 2, contract::error_schedule(256), true);
  plan.finish(0, 9);  // as read from the journal after a restart
  EXPECT_EQ(plan.counts().planned, 13);
  EXPECT_EQ(plan.counts().committed, 9);
}

TEST(JobPlan, OnDemandExtendingKeepsCommittedUnits) {
  JobPlan plan({0}, 2, contract::error_schedule(64), true);  // 8, 32, 64
  for (const std::int32_t pass : {0, 1, 2}) plan.commit({0, 0, pass});
  plan.commit({0, 1, 0});
  EXPECT_TRUE(plan.extend(contract::error_schedule(256), true).empty());
  EXPECT_EQ(plan.counts().planned, 5);
  EXPECT_EQ(plan.counts().committed, 4);
  EXPECT_EQ(take(plan, 1, 100), (std::vector<Unit>{{0, 1, 1}}));
}

}  // namespace
}  // namespace tessera::server
