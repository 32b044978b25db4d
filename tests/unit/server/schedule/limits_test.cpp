// Pools of workers, and limits on the leases of all jobs together.
#include "server/schedule/queue/limits.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

TEST(Limits, RoomIsThatOfScarcestLimit) {
  Limits limits;
  limits.set("licence", 5);
  limits.set("memory", 100);
  EXPECT_EQ(limits.room({}), std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(limits.room({{"unknown", 3}}), std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(limits.room({{"licence", 2}}), 2);
  EXPECT_EQ(limits.room({{"licence", 1}, {"memory", 30}}), 3);
  limits.take({{"licence", 2}}, 2);
  EXPECT_EQ(limits.room({{"licence", 1}}), 1);
  limits.set("licence", 3);
  EXPECT_EQ(limits.room({{"licence", 1}}), 0) << "lowered below its use";
  limits.take({{"licence", 2}}, -2);
  EXPECT_EQ(limits.room({{"licence", 1}}), 3);
}

TEST(Limits, UseOfRemovedLimitIsStillCounted) {
  Limits limits;
  limits.set("licence", 1);
  limits.take({{"licence", 1}}, 1);
  EXPECT_TRUE(limits.remove("licence"));
  EXPECT_FALSE(limits.remove("licence"));
  limits.set("licence", 1);
  EXPECT_EQ(limits.room({{"licence", 1}}), 0);
}

std::int64_t used(const SchedulerHarness& farm) {
  return farm.scheduler.limits().table().all().at("licence").used;
}

TEST(Limits, LeasesOfAllJobsStayWithinLimit) {
  SchedulerHarness farm;
  farm.scheduler.limits().set_limit("licence", 3, farm.now);
  const WorkerKey one = farm.connect("w1", {.threads = 8, .credits = 8});
  const WorkerKey other = farm.connect("w2", {.threads = 8, .credits = 8});
  farm.queue_job({.tiles = 40, .limits = {{"licence", 1}}});
  farm.queue_job({.tiles = 40, .owner = "ben", .limits = {{"licence", 2}}});
  farm.scheduler.dispatcher().dispatch_all(farm.now);
  int committed = 0;
  for (int round = 0; round < 200; ++round) {
    EXPECT_LE(used(farm), 3);
    for (const WorkerKey worker : {one, other}) {
      for (const UnitName& unit : farm.leased(worker)) {
        farm.complete(worker, unit);
        ++committed;
        EXPECT_LE(used(farm), 3);
      }
    }
    farm.pass(SchedulerHarness::kPeriod, {one, other});
    ASSERT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
  }
  EXPECT_EQ(committed, 80);
  EXPECT_EQ(used(farm), 0);
}

TEST(Limits, JobWithoutRoomLetsOthersPass) {
  SchedulerHarness farm;
  farm.scheduler.limits().set_limit("licence", 0, farm.now);
  const WorkerKey worker = farm.connect("w1");
  const Job& limited = farm.add_job({.priority = 50, .limits = {{"licence", 1}}});
  const Job& other = farm.add_job({});
  EXPECT_EQ(farm.leased(worker).at(0).job_id, other.spec->id);
  EXPECT_EQ(farm.scheduler.waiting().wait_text(limited),
            "limit licence is reached: 0 of 0 units are in use, a lease needs 1");
}

TEST(Limits, LostWorkersLeasesCountNoLonger) {
  SchedulerHarness farm;
  farm.scheduler.limits().set_limit("licence", 2, farm.now);
  farm.connect("w1", {.credits = 8});
  farm.add_job({.limits = {{"licence", 1}}});
  EXPECT_EQ(used(farm), 2);
  const WorkerKey other = farm.connect("w2", {.credits = 8});
  EXPECT_TRUE(farm.leased(other).empty());
  farm.pass(std::chrono::seconds(6), {other});  // w1 is silent
  EXPECT_EQ(farm.leased(other).size(), 2u);
  EXPECT_EQ(used(farm), 2);
}

TEST(Limits, AdoptedUnitsCountAfterRestart) {
  SchedulerHarness before;
  before.scheduler.limits().set_limit("licence", 2, before.now);
  const WorkerKey worker = before.connect("w1", {.credits = 8});
  before.add_job({.limits = {{"licence", 1}}});
  const std::vector<UnitName> units = before.leased(worker);
  ASSERT_EQ(units.size(), 2u);
  SchedulerHarness after({"w1"});
  after.scheduler.limits().set_limit("licence", 2, after.now);
  after.add_job({.limits = {{"licence", 1}}});
  const WorkerKey early = after.connect("w2", {.credits = 8});
  EXPECT_TRUE(after.leased(early).empty()) << "the worker that holds leases may come back";
  SchedulerHarness::WorkerPlanned hello{.credits = 6};
  for (const UnitName& unit : units) {
    hello.leases.push_back(before.leases.at({worker, unit}));
    hello.running.push_back(unit);
  }
  after.connect("w1", hello);
  EXPECT_EQ(used(after), 2);
  after.pass(std::chrono::seconds(1), {early});
  EXPECT_TRUE(after.leased(early).empty());
}

TEST(Limits, AuditsCountToo) {
  SchedulePolicy policy;
  policy.audit_fraction = 1;
  SchedulerHarness farm({}, policy);
  farm.scheduler.limits().set_limit("licence", 1, farm.now);
  const WorkerKey one = farm.connect("w1", {.credits = 1});
  Job& job = farm.add_job({.tiles = 2, .limits = {{"licence", 1}}});
  const UnitName unit = farm.leased(one).at(0);
  farm.commit(one, unit);
  farm.scheduler.audits().open_audit(job, unit.unit, "w1", contract::sha256("pixels"));
  const WorkerKey other = farm.connect("w2", {.credits = 4});
  EXPECT_EQ(farm.leased(other).size(), 1u) << "the audit";
  EXPECT_EQ(used(farm), 1);
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(Limits, LimitedJobsCostNoLooks) {
  SchedulerHarness farm;
  farm.scheduler.limits().set_limit("licence", 0, farm.now);
  for (int i = 0; i < 1000; ++i) farm.queue_job({.tiles = 1, .limits = {{"licence", 1}}});
  const std::int64_t before = farm.scheduler.step_count();
  farm.connect("w1", {.threads = 1, .credits = 1});
  EXPECT_LE(farm.scheduler.step_count() - before, 10);
}

TEST(Pools, WorkersRenderJobsOfTheirPoolOnly) {
  SchedulerHarness farm;
  const WorkerKey day = farm.connect("w1");
  const WorkerKey night = farm.connect("w2", {.tags = {"gpu"}, .pool = "night"});
  const Job& any = farm.add_job({.tiles = 2});
  const Job& late = farm.add_job({.tiles = 2, .pool = "night"});
  const Job& tagged = farm.add_job({.tiles = 2, .tag = "gpu"});
  const Job& nowhere = farm.add_job({.tiles = 2, .pool = "weekend"});
  for (const UnitName& unit : farm.leased(day)) EXPECT_EQ(unit.job_id, any.spec->id);
  for (const UnitName& unit : farm.leased(night)) EXPECT_EQ(unit.job_id, late.spec->id);
  EXPECT_EQ(farm.scheduler.waiting().wait_text(nowhere), "no connected worker is in pool weekend");
  EXPECT_EQ(farm.scheduler.waiting().wait_text(tagged), "no connected worker has tag gpu");
}

TEST(Pools, MovedWorkerReturnsUnstartedUnits) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 2});
  farm.add_job({.tiles = 2});
  const Job& late = farm.add_job({.tiles = 2, .pool = "night"});
  const std::vector<UnitName> units = farm.leased(worker);
  farm.scheduler.orders().move("w1", "night", farm.now);
  EXPECT_EQ(farm.outbox(worker).revoked, units);
  farm.scheduler.connections().return_units(worker, units, farm.now);
  farm.scheduler.connections().grant_credits(worker, 2, farm.now);
  EXPECT_EQ(farm.leased(worker).at(0).job_id, late.spec->id);
  farm.connect("w1", {.pool = "day"});
  EXPECT_EQ(farm.scheduler.workers().find(worker)->pool, "night") << "the operator decides";
  farm.scheduler.orders().move("w1", "", farm.now);
  EXPECT_EQ(farm.scheduler.workers().find(worker)->pool, "day");
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(Change, PriorityOfRunningJobTakesEffect) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  Job& first = farm.add_job({.tiles = 9, .priority = 10});
  Job& second = farm.add_job({.tiles = 9});
  const UnitName unit = farm.leased(worker).at(0);
  EXPECT_EQ(unit.job_id, first.spec->id);
  auto spec = std::make_shared<JobSpec>(*second.spec);
  spec->priority = 20;
  farm.scheduler.changes().change(second, spec, farm.now);
  farm.complete(worker, unit);
  EXPECT_EQ(farm.leased(worker).at(0).job_id, second.spec->id);
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(Change, RequirementsAndLimitsOfRunningJobTakeEffect) {
  SchedulerHarness farm;
  farm.scheduler.limits().set_limit("licence", 4, farm.now);
  const WorkerKey plain = farm.connect("w1", {.threads = 1, .credits = 2});
  Job& job = farm.add_job({.tiles = 9});
  const std::vector<UnitName> units = farm.leased(plain);
  ASSERT_EQ(units.size(), 2u);
  auto spec = std::make_shared<JobSpec>(*job.spec);
  spec->required_tag = "gpu";
  spec->max_workers = 1;
  spec->limits = {{"licence", 2}};
  farm.scheduler.changes().change(job, spec, farm.now);
  EXPECT_EQ(used(farm), 4) << "units in flight count";
  for (const UnitName& unit : units) farm.complete(plain, unit);
  EXPECT_EQ(used(farm), 0);
  EXPECT_TRUE(farm.leased(plain).empty());
  const WorkerKey gpu = farm.connect("w2", {.threads = 1, .credits = 3, .tags = {"gpu"}});
  EXPECT_EQ(farm.leased(gpu).size(), 2u) << "two units of the limit each";
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(FairShare, UseWithoutUnitsInFlightOutlivesRestart) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 2});
  farm.add_job({.tiles = 2, .owner = "ann"});
  farm.commit(worker, farm.leased(worker).at(0), 500);
  const auto table = farm.scheduler.limits().usage(farm.now);
  ASSERT_EQ(table.size(), 1u);
  EXPECT_NEAR(table[0].cpu_seconds, 500, 1e-6)
      << "the unit in flight is charged to the next process";
}

}  // namespace
}  // namespace tessera::server
