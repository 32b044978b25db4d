// Cost of decisions, counted in workers and jobs looked at, so that it does not depend on the
// machine.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

/// Returns the steps that `work` takes.
std::int64_t steps(SchedulerHarness& farm, const std::function<void()>& work) {
  const std::int64_t before = farm.scheduler.step_count();
  work();
  return farm.scheduler.step_count() - before;
}

/// Queues jobs that no worker of the tests can serve.
void queue_unservable(SchedulerHarness& farm, int count) {
  for (int i = 0; i < count; ++i) {
    farm.queue_job({.tiles = 4,
                    .priority = i % 100,
                    .owner = "owner" + std::to_string(i % 50),
                    .tag = "tag" + std::to_string(i % 500)});
  }
}

TEST(Cost, UnservableJobsCostNothing) {
  std::int64_t least = 0;
  for (const int unservable : {0, 100'000}) {
    SchedulerHarness farm;
    queue_unservable(farm, unservable);
    const WorkerKey worker = farm.connect("w1", {.credits = 1});
    const WorkerKey other = farm.connect("w2", {.credits = 1, .tags = {"big"}});
    const std::int64_t count = steps(farm, [&] {
      farm.add_job({.tiles = 100});
      for (int i = 0; i < 50; ++i) {
        for (const UnitName& unit : farm.leased(worker)) farm.complete(worker, unit);
      }
      farm.pass(1s, {worker, other});
    });
    if (unservable == 0) least = count;
    EXPECT_LE(count, least) << unservable << " jobs";
    EXPECT_GT(count, 0);
  }
}

TEST(Cost, IdleTicksOfUnservableJobsAreFree) {
  SchedulerHarness farm;
  queue_unservable(farm, 1000);
  std::vector<WorkerKey> workers;
  for (int i = 0; i < 100; ++i) workers.push_back(farm.connect("w" + std::to_string(i)));
  EXPECT_EQ(steps(farm, [&] { farm.pass(10s, workers); }), 0);
}

/// A thousand changes take milliseconds, and 20 s if they visit the jobs.
TEST(Cost, WeightsAndBudgetsDoNotWalkQueuedJobs) {
  SchedulerHarness farm;
  queue_unservable(farm, 100'000);
  farm.add_job({.tiles = 4, .owner = "ann"});
  farm.connect("w1", {.credits = 2});
  FarmLimits& limits = farm.scheduler.limits();
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 1000; ++i) {
    limits.set_weight("ann", 1 + i, farm.now);
    ASSERT_FALSE(limits.usage(farm.now).size() > 100);
    limits.stop_accounts({}, farm.now);
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, 5s);
}

TEST(Cost, BansDoNotWalkQueuedJobs) {
  SchedulerHarness farm;
  queue_unservable(farm, 100'000);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 1000; ++i) farm.scheduler.quarantine().ban("w" + std::to_string(i));
  EXPECT_LT(std::chrono::steady_clock::now() - start, 2s);
}

TEST(Cost, FullJobsAreNotWalked) {
  SchedulerHarness farm;
  std::vector<WorkerKey> busy;
  for (int i = 0; i < 200; ++i) {  // each has the one worker that it may have
    farm.add_job({.tiles = 40, .max_workers = 1});
    busy.push_back(farm.connect("w" + std::to_string(i), {.threads = 1, .credits = 1}));
    ASSERT_EQ(farm.leased(busy.back()).size(), 1u);
  }
  const WorkerKey idle = farm.connect("idle", {.threads = 1, .credits = 1});
  EXPECT_TRUE(farm.leased(idle).empty());
  EXPECT_LE(steps(farm, [&] { farm.scheduler.connections().grant_credits(idle, 1, farm.now); }), 4);
}

TEST(Cost, ReturningWorkersCostLinearWork) {
  for (const bool has_work : {false, true}) {
    const auto cost = [&](int workers) {
      SchedulerHarness farm;
      queue_unservable(farm, 100);
      if (has_work) farm.queue_job({.tiles = 4 * workers, .frames = 100});
      return steps(farm, [&] {
        for (int i = 0; i < workers; ++i) {
          farm.connect("w" + std::to_string(i), {.threads = 2, .credits = 2, .tags = {"big"}});
        }
      });
    };
    const std::int64_t few = cost(500), many = cost(5000);
    EXPECT_LE(many, 11 * few);
    EXPECT_LE(many, 20 * 5000);
  }
}

TEST(Cost, WorkersThatKeepLeasesCostLinearWork) {
  constexpr int kWorkers = 5000;
  SchedulerHarness farm;
  farm.add_job({.tiles = 8000, .frames = 10});
  std::vector<WorkerKey> workers;
  for (int i = 0; i < kWorkers; ++i) {
    workers.push_back(farm.connect("w" + std::to_string(i), {.threads = 1, .credits = 1}));
  }
  std::vector<SchedulerHarness::WorkerPlanned> back(kWorkers);
  for (int i = 0; i < kWorkers; ++i) {
    const auto index = static_cast<std::size_t>(i);
    back[index] = {.threads = 1, .credits = 1};
    back[index].running = farm.leased(workers[index]);
    for (const UnitName& unit : back[index].running) {
      back[index].leases.push_back(farm.leases.at({workers[index], unit}));
    }
    farm.scheduler.connections().disconnect(workers[index]);
  }
  const std::int64_t count = steps(farm, [&] {
    for (int i = 0; i < kWorkers; ++i) {
      farm.connect("w" + std::to_string(i), back[static_cast<std::size_t>(i)]);
    }
  });
  EXPECT_LE(count, 20 * kWorkers);
}

TEST(Cost, AuditsOfOthersAreNotWalked) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1000, .frames = 1, .tag = "big"});
  const WorkerKey worker = farm.connect("w1", {.threads = 8, .credits = 1000, .tags = {"big"}});
  const auto units = farm.leased(worker);
  ASSERT_EQ(units.size(), 1000u);
  for (const UnitName& unit : units) {
    farm.commit(worker, unit);
    farm.scheduler.audits().open_audit(job, unit.unit, "w1", contract::sha256("x"));
  }
  const WorkerKey plain = farm.connect("w2", {.threads = 1, .credits = 1});
  EXPECT_TRUE(farm.leased(plain).empty());
  EXPECT_LE(steps(farm,
                  [&] {
                    farm.scheduler.connections().grant_credits(worker, 1, farm.now);
                    farm.scheduler.connections().grant_credits(plain, 1, farm.now);
                  }),
            8);
}

// Reasons -----------------------------------------------------------------------------------------

TEST(WaitReason, NamesWhatTheJobWaitsFor) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 40});
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(job), WaitReason::no_workers);
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(job), WaitReason::none);
  Job& tagged = farm.add_job({.tiles = 1, .tag = "big"});
  EXPECT_EQ(farm.scheduler.waiting().wait_text(tagged), "no connected worker has tag big");
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(farm.add_job({.tiles = 1})),
            WaitReason::older_job);
  Job& of_ben = farm.add_job({.tiles = 1, .owner = "ben"});
  farm.scheduler.connections().scene_loaded(worker, "j1", {100, 0});  // the worker stays with it
  farm.complete(worker, farm.leased(worker).at(0), 1);
  farm.scheduler.take_effects();
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(of_ben), WaitReason::farm_busy);
  farm.add_job({.tiles = 1, .priority = 1});
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(of_ben), WaitReason::priority);
  ASSERT_TRUE(farm.scheduler.lifecycle().pause(of_ben, "asked", farm.now).ok());
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(of_ben), WaitReason::none);
}

TEST(WaitReason, SayThatAnotherOwnerHasUsedLess) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  farm.add_job({.tiles = 1, .owner = "ann"});
  farm.complete(worker, farm.leased(worker).at(0), 100);
  farm.add_job({.tiles = 40, .owner = "ben"});
  Job& of_ann = farm.add_job({.tiles = 40, .owner = "ann"});
  farm.complete(worker, farm.leased(worker).at(0), 1);
  farm.scheduler.take_effects();
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(of_ann), WaitReason::share);
}

TEST(Demand, RemovedJobLeavesThatOfOthers) {
  SchedulerHarness farm;
  for (int i = 0; i < 3; ++i) farm.queue_job({.tiles = 4});
  farm.scheduler.lifecycle().remove_job(1);
  EXPECT_EQ(farm.scheduler.jobs().demand("ann").jobs, 2);
}

TEST(Contribution, RestoredPartsAddUp) {
  SchedulerHarness farm;
  Job& job = farm.queue_job({.tiles = 4});
  farm.scheduler.results().restore_contribution(job, "w1", {2, 3});
  farm.scheduler.results().restore_contribution(job, "w1", {1, 4});
  EXPECT_EQ(job.contributions.at("w1").units, 3);
  EXPECT_EQ(job.contributions.at("w1").cpu_seconds, 7);
  EXPECT_EQ(job.counters.cpu_seconds, 7);
}

TEST(WaitReason, RestartWaitsForKnownWorkers) {
  SchedulerHarness farm({"w1", "w2"});
  Job& job = farm.add_job({.tiles = 4});
  farm.connect("w1");
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(job), WaitReason::restart);
}

TEST(WaitReason, RestartEndsWithItsGrace) {
  SchedulerHarness farm({"w1", "w2"});
  Job& job = farm.queue_job({.tiles = 4});
  farm.queue_job({.tiles = 2, .priority = 1});  // takes both credits
  farm.connect("w1", {.threads = 1, .credits = 1});
  farm.now += SchedulePolicy().restart_grace;
  farm.connect("w3", {.threads = 1, .credits = 1});  // before a timer runs
  farm.scheduler.dispatcher().dispatch_all(farm.now);
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(job), WaitReason::farm_busy);
}

}  // namespace
}  // namespace tessera::server
