#include "server/schedule/scheduler/scheduler.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

// Leases ------------------------------------------------------------------------------------------

TEST(Scheduler, LeasesNoMoreThanCredits) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 100});
  const WorkerKey worker = farm.connect("w1", {.credits = 5});
  EXPECT_EQ(farm.leased(worker).size(), 5u);
  farm.scheduler.connections().grant_credits(worker, 2, farm.now);
  EXPECT_EQ(farm.leased(worker).size(), 2u);
}

TEST(Scheduler, LeasesHaveSealAndUniqueNumber) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 100});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 40});
  std::set<Attempt> attempts;
  for (const Lease& lease : farm.outbox(worker).leases) {
    EXPECT_TRUE(is_seal_valid(lease, "w1", "key"));
    EXPECT_TRUE(attempts.insert(lease.attempt).second);
    EXPECT_EQ(lease.attempt.boot, 1);
  }
}

TEST(Scheduler, RunsShrinkTowardsEnd) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 64});
  const WorkerKey worker = farm.connect("w1", {.threads = 2, .credits = 64});
  std::vector<std::int32_t> lengths;
  for (const Lease& lease : farm.outbox(worker).leases) lengths.push_back(lease.tile_count);
  ASSERT_GT(lengths.size(), 3u);
  EXPECT_EQ(lengths.front(), 64 / (2 * 2)) << "units left / (2 x threads of the farm)";
  EXPECT_EQ(lengths.back(), 1);
  EXPECT_TRUE(std::is_sorted(lengths.rbegin(), lengths.rend()));
}

TEST(Scheduler, RemainingUnitsAreSharedNearEnd) {
  SchedulerHarness farm;
  const WorkerKey one = farm.connect("w1", {.threads = 2, .credits = 100});
  const WorkerKey two = farm.connect("w2", {.threads = 2, .credits = 100});
  farm.add_job({.tiles = 8});
  EXPECT_EQ(farm.leased(one).size(), 4u);
  EXPECT_EQ(farm.leased(two).size(), 4u);
}

TEST(Scheduler, PlanIsCreatedAtFirstLease) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 4, .frames = 1000});
  EXPECT_FALSE(job.plan);
  EXPECT_EQ(job.unit_count, 4000);
  farm.connect("w1");
  EXPECT_TRUE(job.plan);
  EXPECT_EQ(job.state, JobState::running);
}

TEST(Scheduler, HugeCreditsDoNotOverflow) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1");
  for (int i = 0; i < 10; ++i)
    farm.scheduler.connections().grant_credits(worker, 2'000'000'000, farm.now);
  EXPECT_GT(farm.scheduler.workers().find(worker)->credits, 0);
  farm.scheduler.connections().grant_credits(worker, -5, farm.now);
  EXPECT_GT(farm.scheduler.workers().find(worker)->credits, 0);
}

// Loss and reconnection ---------------------------------------------------------------------------

TEST(Scheduler, SilentWorkerLosesUnitsAfter5Seconds) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 4});
  const WorkerKey silent = farm.connect("w1", {.threads = 4, .credits = 4});
  ASSERT_EQ(farm.leased(silent).size(), 4u);
  const WorkerKey other = farm.connect("w2", {.threads = 4, .credits = 4});
  farm.pass(4900ms, {other});
  EXPECT_TRUE(farm.leased(other).empty());
  farm.pass(300ms, {other});
  EXPECT_EQ(farm.leased(other).size(), 4u);
  EXPECT_EQ(job.counters.retried, 4);
  EXPECT_EQ(farm.scheduler.take_effects().to_close, std::vector<WorkerKey>{silent});
}

TEST(Scheduler, BrokenStreamKeepsLeases) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 4});
  const WorkerKey worker = farm.connect("w1", {.threads = 4, .credits = 4});
  const auto units = farm.leased(worker);
  farm.scheduler.connections().disconnect(worker);
  const WorkerKey other = farm.connect("w2", {.threads = 4, .credits = 4});
  farm.pass(3s, {other});
  EXPECT_TRUE(farm.leased(other).empty());
  SchedulerHarness::WorkerPlanned back{.threads = 4, .credits = 0};
  for (const UnitName& unit : units) back.leases.push_back(farm.leases.at({worker, unit}));
  back.running = units;
  EXPECT_EQ(farm.connect("w1", back), worker) << "it is the same worker";
  farm.pass(10s, {worker, other});
  for (const UnitName& unit : units) {
    EXPECT_EQ(farm.scheduler.workers().find(worker)->leased_units.count({1, unit.unit}), 1u);
  }
}

TEST(Scheduler, UnlistedUnitsAreLeasedAgain) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 4});
  const WorkerKey worker = farm.connect("w1", {.threads = 4, .credits = 4});
  const auto units = farm.leased(worker);
  SchedulerHarness::WorkerPlanned back{.threads = 4, .credits = 3};
  back.leases = {farm.leases.at({worker, units[0]})};
  back.running = {units[0]};
  farm.connect("w1", back);
  EXPECT_EQ(farm.leased(worker).size(), 3u);
  EXPECT_TRUE(job.unit_failures.empty());
}

TEST(Scheduler, AdoptsOnlyLeasesWithValidSeal) {
  for (const bool is_forged : {true, false}) {
    SchedulerHarness farm;
    Job& job = farm.add_job({.tiles = 2});
    Lease lease{"j1", 0, 0, 0, 2, 0, 8, {1, 77}, {}};
    lease.seal = make_seal(lease, "w1", is_forged ? "wrong key" : "key");
    SchedulerHarness::WorkerPlanned hello{
        .credits = 0, .leases = {lease}, .running = {{"j1", {0, 0, 0}}}};
    farm.connect("w1", hello);
    EXPECT_EQ(job.plan && job.plan->find_in_flight({0, 0, 0}) != nullptr, !is_forged);
    hello.store_id = "another";
    farm.connect("w1", hello);
    EXPECT_FALSE(job.plan && job.plan->find_in_flight({0, 0, 0}) != nullptr);
  }
}

TEST(Scheduler, GrantsWaitForKnownWorkersUntilTimeout) {
  SchedulerHarness farm({"w1", "w2"});
  farm.add_job({.tiles = 8});
  const WorkerKey one = farm.connect("w1");
  farm.pass(2s, {one});
  EXPECT_TRUE(farm.leased(one).empty());
  const WorkerKey two = farm.connect("w2");
  EXPECT_FALSE(farm.leased(one).empty()) << "all known workers are back";
  EXPECT_FALSE(farm.leased(two).empty());

  SchedulerHarness alone({"w1", "gone"});
  alone.add_job({.tiles = 8});
  const WorkerKey worker = alone.connect("w1");
  alone.pass(4900ms, {worker});
  EXPECT_TRUE(alone.leased(worker).empty());
  alone.pass(200ms, {worker});
  EXPECT_FALSE(alone.leased(worker).empty());
}

TEST(Scheduler, DelayedTickDoesNotExpireWorkers) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 4});
  const WorkerKey worker = farm.connect("w1");
  farm.pass(1s, {worker});
  farm.now += 60s;  // the server was stopped (SIGSTOP)
  farm.scheduler.tick(farm.now, SchedulerHarness::kPeriod);
  farm.pass(200ms, {});
  EXPECT_FALSE(farm.scheduler.workers().find(worker)->lost);
  farm.pass(6s, {});
  EXPECT_TRUE(farm.scheduler.workers().find(worker)->lost);
}

TEST(Scheduler, DrainingWorkerKeepsUnitsAndGetsNoMore) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 100});
  const WorkerKey worker = farm.connect("w1");
  const auto units = farm.leased(worker);
  farm.scheduler.connections().begin_draining(worker);
  farm.complete(worker, units[0]);
  farm.pass(1s, {worker});
  EXPECT_TRUE(farm.leased(worker).empty());
  EXPECT_EQ(farm.scheduler.workers().find(worker)->leased_units.size(), units.size() - 1);
}

// Failures ----------------------------------------------------------------------------------------

TEST(Scheduler, FailedUnitGoesToAnotherWorker) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey one = farm.connect("w1");
  const auto unit = farm.leased(one).at(0);
  farm.fail(one, unit);
  EXPECT_EQ(farm.leased(one).size(), 1u) << "there is no other worker";
  const WorkerKey two = farm.connect("w2");
  farm.fail(one, unit);
  EXPECT_TRUE(farm.leased(one).empty());
  EXPECT_EQ(farm.leased(two).size(), 1u);
  EXPECT_EQ(job.state, JobState::running);
}

TEST(Scheduler, ThirdFailurePausesJobWithMessages) {
  for (const int workers : {1, 4}) {
    SchedulerHarness farm;
    Job& job = farm.add_job({.tiles = 1});
    std::vector<WorkerKey> keys;
    for (int i = 0; i < workers; ++i) keys.push_back(farm.connect("w" + std::to_string(i)));
    int failures = 0;
    while (!job.is_paused_by_failures() && failures < 10) {
      for (const WorkerKey key : keys) {
        for (const UnitName& unit : farm.leased(key)) {
          farm.fail(key, unit);
          ++failures;
        }
      }
    }
    EXPECT_EQ(failures, 3) << workers << " workers";
    EXPECT_TRUE(job.is_paused_by_failures());
    EXPECT_NE(job.reason.find("broke"), std::string::npos);
    EXPECT_NE(job.reason.find("log"), std::string::npos);
  }
}

TEST(Scheduler, BadSceneFailsJobAtOnce) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 8});
  const WorkerKey worker = farm.connect("w1");
  farm.fail(worker, farm.leased(worker).at(0), absl::StatusCode::kNotFound);
  EXPECT_EQ(job.state, JobState::failed);
  EXPECT_EQ(job.reason, "bad scene: broke");
  EXPECT_EQ(job.failure_code, absl::StatusCode::kNotFound);
}

TEST(Scheduler, EleventhUnitLossPausesJob) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  for (int loss = 1; loss <= 11; ++loss) {
    ASSERT_FALSE(job.is_paused_by_failures()) << "after " << loss - 1 << " losses";
    const WorkerKey worker = farm.connect("w" + std::to_string(loss));
    ASSERT_EQ(farm.leased(worker).size(), 1u);
    farm.pass(5200ms, {});
  }
  EXPECT_TRUE(job.is_paused_by_failures());
}

TEST(Scheduler, DisprovedFailuresQuarantineWorker) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 50});
  const WorkerKey bad = farm.connect("bad", {.threads = 1, .credits = 4});
  const auto units = farm.leased(bad);
  ASSERT_EQ(units.size(), 4u);
  const WorkerKey good = farm.connect("good", {.threads = 1, .credits = 0});
  for (std::size_t i = 0; i < 3; ++i) farm.fail(bad, units[i]);
  EXPECT_FALSE(farm.scheduler.workers().find(bad)->quarantined) << "nothing has succeeded yet";
  farm.scheduler.connections().grant_credits(good, 3, farm.now);
  const auto again = farm.leased(good);
  for (const UnitName& unit : again) farm.commit(good, unit);
  EXPECT_TRUE(farm.scheduler.workers().find(bad)->quarantined);
  EXPECT_FALSE(farm.scheduler.workers().find(good)->quarantined);
  farm.outbox(bad);
  farm.scheduler.connections().grant_credits(bad, 5, farm.now);
  EXPECT_TRUE(farm.leased(bad).empty());
}

TEST(Scheduler, UnsealedFailureIsIgnored) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 4});
  const WorkerKey worker = farm.connect("w1");
  Lease lease = farm.outbox(worker).leases.at(0);
  lease.seal[0] = static_cast<char>(lease.seal[0] ^ 1);
  farm.scheduler.failures().fail_unit(worker, lease, lease.first_tile, {"", "forged", ""},
                                      absl::StatusCode::kInvalidArgument, farm.now);
  EXPECT_EQ(job.state, JobState::running);
}

// Priority and fairness ---------------------------------------------------------------------------

TEST(Scheduler, HigherPriorityGoesFirst) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 4});
  farm.add_job({.tiles = 4, .priority = 5});
  const WorkerKey worker = farm.connect("w1", {.threads = 4, .credits = 4});
  for (const UnitName& unit : farm.leased(worker)) EXPECT_EQ(unit.job_id, "j2");
}

TEST(Scheduler, OwnersShareCpuSeconds) {
  SchedulerHarness farm;
  for (int i = 0; i < 3; ++i) farm.add_job({.tiles = 400, .owner = "ann"});
  farm.add_job({.tiles = 400, .owner = "ben"});
  std::map<std::string, double> spent;
  std::vector<std::vector<UnitName>> held(4);
  std::vector<WorkerKey> workers;
  for (int i = 0; i < 4; ++i) {
    workers.push_back(farm.connect("w" + std::to_string(i), {.threads = 1, .credits = 1}));
    farm.scheduler.connections().scene_loaded(workers.back(), "j1", {0, 0});
  }
  for (int round = 0; round < 100; ++round) {
    for (std::size_t i = 0; i < workers.size(); ++i) {
      for (const UnitName& unit : farm.leased(workers[i])) {
        const bool is_ben = unit.job_id == "j4";
        spent[is_ben ? "ben" : "ann"] += is_ben ? 3 : 1;  // ben's units cost three times as much
        farm.scheduler.connections().scene_loaded(workers[i], unit.job_id, {0, 0});
        farm.complete(workers[i], unit, is_ben ? 3 : 1);
      }
    }
  }
  EXPECT_NEAR(spent["ann"] / spent["ben"], 1, 0.1);
}

TEST(Scheduler, WorkerStaysUntilSceneLoadIsAmortised) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 400, .owner = "ann"});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  farm.add_job({.tiles = 400, .owner = "ben"});
  int stayed = 0;
  farm.scheduler.connections().scene_loaded(worker, "j1", {1, 1});  // 2 s to load: 20 s of work
  auto units = farm.leased(worker);
  while (!units.empty() && units[0].job_id == "j1" && stayed < 100) {
    ++stayed;
    farm.complete(worker, units[0], 1);
    units = farm.leased(worker);
  }
  EXPECT_EQ(stayed, 20);
}

TEST(Scheduler, WorkerWithoutLoadReportChangesJobs) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 400, .owner = "ann"});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  farm.add_job({.tiles = 400, .owner = "ben"});
  farm.complete(worker, farm.leased(worker).at(0), 1);
  EXPECT_EQ(farm.leased(worker).at(0).job_id, "j2");
}

TEST(Scheduler, PriorityJobInterruptsStay) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 400});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  farm.scheduler.connections().scene_loaded(worker, "j1", {100, 0});
  farm.add_job({.tiles = 4, .priority = 1});
  farm.complete(worker, farm.leased(worker).at(0));
  EXPECT_EQ(farm.leased(worker).at(0).job_id, "j2");
}

TEST(Scheduler, RequiredTagAndMaxWorkersAreEnforced) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 40, .max_workers = 1, .tag = "big"});
  const WorkerKey plain = farm.connect("w1");
  const WorkerKey big = farm.connect("w2", {.tags = {"big", "fast"}});
  const WorkerKey also_big = farm.connect("w3", {.tags = {"big"}});
  EXPECT_TRUE(farm.leased(plain).empty());
  EXPECT_FALSE(farm.leased(big).empty());
  EXPECT_TRUE(farm.leased(also_big).empty());
}

// Job states --------------------------------------------------------------------------------------

TEST(Scheduler, PausedJobKeepsRunningUnits) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 40});
  const WorkerKey worker = farm.connect("w1");
  const auto units = farm.leased(worker);
  ASSERT_TRUE(farm.scheduler.lifecycle().pause(job, "asked", farm.now).ok());
  farm.complete(worker, units[0]);
  const Outbox outbox = farm.outbox(worker);
  EXPECT_TRUE(outbox.leases.empty() && outbox.revoked.empty());
  EXPECT_EQ(job.plan->counts().committed, 1);
  ASSERT_TRUE(farm.scheduler.lifecycle().resume(job, farm.now).ok());
  EXPECT_EQ(farm.leased(worker).size(), 1u);
}

TEST(Scheduler, CancellingRevokesAllLeases) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 40});
  const WorkerKey worker = farm.connect("w1");
  const auto units = farm.leased(worker);
  ASSERT_TRUE(farm.scheduler.lifecycle().cancel(job, farm.now).ok());
  const Outbox outbox = farm.outbox(worker);
  EXPECT_EQ(outbox.revoked, units);
  EXPECT_EQ(outbox.ended_jobs, std::vector<std::string>{"j1"});
  const Lease lease = farm.leases.at({worker, units[0]});
  EXPECT_FALSE(farm.scheduler.results().wants(job, lease, units[0].unit))
      << "late results are unwanted";
  EXPECT_TRUE(farm.scheduler.lifecycle().cancel(job, farm.now).ok()) << "idempotent";
}

TEST(Scheduler, RetryKeepsUnitsAndResetsFailures) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 2});
  const WorkerKey worker = farm.connect("w1", {.threads = 2, .credits = 2});
  const auto units = farm.leased(worker);
  farm.complete(worker, units[0]);
  for (int i = 0; i < 3; ++i) {
    farm.fail(worker, units[1]);
    farm.leased(worker);
  }
  ASSERT_TRUE(job.is_paused_by_failures());
  ASSERT_TRUE(farm.scheduler.lifecycle().retry(job, farm.now).ok());
  EXPECT_EQ(job.state, JobState::running);
  EXPECT_EQ(farm.leased(worker), std::vector<UnitName>{units[1]});
  farm.fail(worker, units[1]);
  EXPECT_EQ(job.state, JobState::running);
}

TEST(Scheduler, RetryOfJobWithAllFramesEndsIt) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey worker = farm.connect("w1");
  for (const UnitName& unit : farm.leased(worker)) farm.commit(worker, unit);
  ASSERT_TRUE(farm.scheduler.lifecycle().cancel(job, farm.now).ok());
  farm.scheduler.results().finish_frame(job, 0, farm.now);  // its image was being written
  EXPECT_EQ(job.state, JobState::cancelled);
  ASSERT_TRUE(farm.scheduler.lifecycle().retry(job, farm.now).ok());
  EXPECT_EQ(job.state, JobState::done);
}

TEST(Scheduler, JobIsDoneWithLastFrame) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1, .frames = 2});
  const WorkerKey worker = farm.connect("w1");
  for (const UnitName& unit : farm.leased(worker)) farm.commit(worker, unit);
  farm.scheduler.results().finish_frame(job, 1, farm.now);
  EXPECT_EQ(job.state, JobState::running);
  farm.scheduler.results().finish_frame(job, 0, farm.now);
  EXPECT_EQ(job.state, JobState::done);
  EXPECT_FALSE(farm.scheduler.lifecycle().cancel(job, farm.now).ok());
  EXPECT_FALSE(farm.scheduler.lifecycle().retry(job, farm.now).ok());
}

// End of a job ------------------------------------------------------------------------------------

/// Two workers and one remaining unit, started by the first.
struct Tail {
  Tail() {
    units = farm.leased(slow);
    farm.start(slow, units);
    for (std::size_t i = 1; i < units.size(); ++i) farm.complete(slow, units[i], 1);
    fast = farm.connect("fast", {.threads = 2, .credits = 2});
  }
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 4});
  WorkerKey slow = farm.connect("slow", {.threads = 4, .credits = 4});
  WorkerKey fast = 0;
  std::vector<UnitName> units;
};

TEST(Scheduler, SlowUnitIsCopiedOnce) {
  Tail tail;
  tail.farm.pass(1900ms, {tail.slow, tail.fast});
  EXPECT_TRUE(tail.farm.leased(tail.fast).empty());
  tail.farm.pass(300ms, {tail.slow, tail.fast});
  EXPECT_EQ(tail.farm.leased(tail.fast), std::vector<UnitName>{tail.units[0]});
  const WorkerKey third = tail.farm.connect("third");
  tail.farm.pass(10s, {tail.slow, tail.fast, third});
  EXPECT_TRUE(tail.farm.leased(third).empty()) << "never a second copy";
}

TEST(Scheduler, CommitRevokesOtherCopy) {
  Tail tail;
  tail.farm.pass(3s, {tail.slow, tail.fast});
  tail.farm.leased(tail.fast);
  tail.farm.outbox(tail.slow);
  tail.farm.commit(tail.fast, tail.units[0]);
  EXPECT_EQ(tail.farm.outbox(tail.slow).revoked, std::vector<UnitName>{tail.units[0]});
  EXPECT_TRUE(tail.farm.outbox(tail.fast).revoked.empty());
  EXPECT_TRUE(tail.farm.scheduler.workers().find(tail.slow)->leased_units.empty());
}

TEST(Scheduler, UnstartedUnitsMoveToIdleWorkers) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 8});
  const WorkerKey busy = farm.connect("busy", {.threads = 2, .credits = 8});
  const auto units = farm.leased(busy);
  ASSERT_EQ(units.size(), 8u);
  farm.start(busy, {units[0], units[1]});
  const WorkerKey idle = farm.connect("idle", {.threads = 2, .credits = 4});
  farm.pass(200ms, {busy, idle});
  const auto revoked = farm.outbox(busy).revoked;
  ASSERT_EQ(revoked.size(), 2u) << "as many as the idle threads";
  farm.scheduler.connections().return_units(busy, revoked, farm.now);
  EXPECT_EQ(farm.leased(idle).size(), 2u);
}

TEST(Scheduler, UnstartedUnitsMoveBesideAdoptedOnes) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 8});
  Lease lease{"j1", 0, 0, 0, 2, 0, 8, {1, 77}, {}};
  lease.seal = make_seal(lease, "busy", "key");
  const std::vector<UnitName> adopted{{"j1", {0, 0, 0}}, {"j1", {0, 1, 0}}};
  const WorkerKey busy =
      farm.connect("busy", {.threads = 2, .credits = 6, .leases = {lease}, .running = adopted});
  ASSERT_EQ(farm.leased(busy).size(), 6u);
  const WorkerKey idle = farm.connect("idle", {.threads = 2, .credits = 4});
  farm.pass(200ms, {busy, idle});
  EXPECT_EQ(farm.outbox(busy).revoked.size(), 2u) << "adopted units are not being given back";
}

TEST(Scheduler, WorkerKeepsUnitPerThreadOverAllJobs) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 1});
  farm.add_job({.tiles = 1});
  const WorkerKey busy = farm.connect("busy", {.threads = 1, .credits = 2});
  ASSERT_EQ(farm.leased(busy).size(), 2u);
  const WorkerKey idle = farm.connect("idle", {.threads = 4, .credits = 4});
  for (int i = 0; i < 3; ++i) farm.pass(200ms, {busy, idle});
  EXPECT_EQ(farm.outbox(busy).revoked.size(), 1u);
}

TEST(Scheduler, RevokedUnitIsWithdrawnIfItsLeaseIsUnsent) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey worker = farm.connect("w1");
  ASSERT_TRUE(farm.scheduler.lifecycle().cancel(job, farm.now).ok());
  const Outbox outbox = farm.outbox(worker);
  EXPECT_EQ(outbox.leases.size(), 1u);
  EXPECT_TRUE(outbox.revoked.empty());
  EXPECT_EQ(outbox.withdrawn.size(), 1u);
}

}  // namespace
}  // namespace tessera::server
