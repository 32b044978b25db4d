// Workers that are set aside or blocked for a job, and accounts that are stopped.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

void block(SchedulerHarness& farm, Job& job, const std::set<std::string>& workers) {
  auto spec = std::make_shared<JobSpec>(*job.spec);
  spec->blocked_workers = workers;
  farm.scheduler.changes().change(job, spec, farm.now);
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

// Set aside ---------------------------------------------------------------------------------------

TEST(SetAside, WorkerFinishesStartedUnitsAndGetsNoMore) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 40});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 4});
  const auto units = farm.leased(worker);
  ASSERT_EQ(units.size(), 4u);
  farm.start(worker, {units[0]});
  farm.scheduler.orders().set_aside("w1", "new memory", farm.now);
  const Worker& aside = *farm.scheduler.workers().find(worker);
  EXPECT_TRUE(aside.connected);
  EXPECT_EQ(aside.note, "new memory");
  const Outbox mail = farm.outbox(worker);
  EXPECT_EQ(mail.revoked, units) << "the worker returns those that it has not started";
  farm.scheduler.connections().return_units(worker, {units[1], units[2], units[3]}, farm.now);
  farm.complete(worker, units[0]);
  EXPECT_TRUE(job.plan->is_committed(units[0].unit));
  farm.scheduler.connections().grant_credits(worker, 8, farm.now);
  farm.pass(1s, {worker});
  EXPECT_TRUE(farm.leased(worker).empty());
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
  farm.scheduler.orders().bring_back("w1", farm.now);
  EXPECT_FALSE(farm.leased(worker).empty());
}

TEST(SetAside, HoldsOverReconnectAndRestart) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 40});
  farm.scheduler.orders().set_aside("w1", "", farm.now);  // it is not here
  EXPECT_TRUE(farm.leased(farm.connect("w1")).empty());
  EXPECT_FALSE(farm.leased(farm.connect("w2")).empty());
  const WorkerKey again = farm.connect("w1");
  EXPECT_TRUE(farm.leased(again).empty());
  SchedulerHarness restarted({"w1"});
  for (const auto& [worker, reason] : farm.scheduler.orders().placement().aside()) {
    restarted.scheduler.orders().set_aside(worker, reason, restarted.now);
  }
  restarted.add_job({.tiles = 40});
  EXPECT_TRUE(restarted.leased(restarted.connect("w1")).empty());
}

TEST(SetAside, WorkerIsNoWitness) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 1});
  farm.connect("w2", {.threads = 1, .credits = 0});
  farm.scheduler.orders().set_aside("w2", "", farm.now);
  for (int i = 0; i < 3; ++i) {
    for (const UnitName& unit : farm.leased(one)) farm.fail(one, unit);
  }
  EXPECT_TRUE(job.is_paused_by_failures()) << "nobody else could be asked";
}

// Blocked for a job -------------------------------------------------------------------------------

TEST(BlockedWorker, RendersOtherJobsOnly) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 40});
  block(farm, job, {"w1"});
  const WorkerKey worker = farm.connect("w1");
  EXPECT_TRUE(farm.leased(worker).empty());
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(job), WaitReason::blocked);
  EXPECT_NE(farm.scheduler.waiting().wait_text(job).find("workers unblock"), std::string::npos);
  farm.add_job({.tiles = 4});
  for (const UnitName& unit : farm.leased(worker)) EXPECT_EQ(unit.job_id, "j2");
  EXPECT_FALSE(farm.leased(farm.connect("w2")).empty());
  farm.scheduler.connections().grant_credits(worker, 4, farm.now);
  EXPECT_TRUE(farm.leased(worker).empty());
  block(farm, job, {});
  EXPECT_FALSE(farm.leased(worker).empty());
}

TEST(BlockedWorker, ReturnsUnitsThatItHasNotStarted) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 40});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 2});
  const auto units = farm.leased(worker);
  block(farm, job, {"w1"});
  EXPECT_EQ(farm.outbox(worker).revoked, units);
}

TEST(BlockedWorker, IsNoWitnessForItsJob) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 1});
  const auto unit = farm.leased(one).at(0);
  const WorkerKey two = farm.connect("w2", {.threads = 1, .credits = 1});
  block(farm, job, {"w2"});
  farm.fail(one, unit);
  EXPECT_TRUE(farm.leased(two).empty());
  EXPECT_EQ(farm.leased(one), std::vector<UnitName>{unit}) << "there is nobody else to ask";
  EXPECT_FALSE(farm.scheduler.audits().wants_audit(job, unit.unit, "w1", farm.now));
}

TEST(BlockedWorker, AuditGoesToAnother) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 1});
  const auto unit = farm.leased(one).at(0);
  const WorkerKey two = farm.connect("w2", {.threads = 1, .credits = 1});
  block(farm, job, {"w2"});
  farm.commit(one, unit);
  farm.scheduler.audits().open_audit(job, unit.unit, "w1", contract::sha256("x"));
  farm.pass(200ms, {one, two});
  EXPECT_TRUE(farm.scheduler.audits().has_audits(job, 0)) << "another worker may come";
  farm.pass(5s, {one, two});
  EXPECT_TRUE(farm.leased(two).empty());
  EXPECT_FALSE(farm.scheduler.audits().has_audits(job, 0)) << "nobody may answer it";
}

// Accounts ----------------------------------------------------------------------------------------

TEST(StoppedAccount, JobsOfOwnerAreLeasedNothing) {
  SchedulerHarness farm;
  Job& anns = farm.add_job({.tiles = 40, .owner = "ann"});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  const auto units = farm.leased(worker);
  ASSERT_EQ(units.size(), 1u);
  farm.scheduler.limits().stop_accounts({{{AccountScope::owner, "ann"}, "used up"}}, farm.now);
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
  farm.complete(worker, units[0]);
  EXPECT_TRUE(anns.plan->is_committed(units[0].unit)) << "what runs is finished";
  EXPECT_TRUE(farm.leased(worker).empty());
  EXPECT_EQ(farm.scheduler.waiting().wait_text(anns), "used up");
  farm.add_job({.tiles = 4, .owner = "ben"});
  EXPECT_EQ(farm.leased(worker).at(0).job_id, "j2");
  Job& late = farm.add_job({.tiles = 4, .owner = "ann"});
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(late), WaitReason::budget);
  farm.scheduler.limits().stop_accounts({}, farm.now);
  EXPECT_FALSE(anns.is_over_budget);
  EXPECT_FALSE(late.is_over_budget);
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(StoppedAccount, JobsOfProjectAreLeasedNothing) {
  SchedulerHarness farm;
  auto spec = std::make_shared<JobSpec>(*farm.queue_job({.tiles = 4}).spec);
  spec->id = "film";
  spec->project = "film";
  Job& job = farm.scheduler.changes().add_job(100, spec, JobState::queued);
  farm.scheduler.limits().stop_accounts({{{AccountScope::project, "film"}, "used up"}}, farm.now);
  const WorkerKey worker = farm.connect("w1", {.threads = 8, .credits = 8});
  for (const UnitName& unit : farm.leased(worker)) EXPECT_EQ(unit.job_id, "j1");
  EXPECT_TRUE(job.is_over_budget);
}

TEST(StoppedAccount, SlowUnitsAreNotCopied) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 8});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 3});
  auto units = farm.leased(one);
  ASSERT_GE(units.size(), 3u);
  farm.complete(one, units[0]);  // now the scheduler knows how long units take
  farm.start(one, {units[1]});
  farm.scheduler.limits().stop_accounts({{{AccountScope::owner, "ann"}, "used up"}}, farm.now);
  const WorkerKey two = farm.connect("w2", {.threads = 1, .credits = 1});
  farm.pass(10s, {one, two});
  EXPECT_TRUE(farm.leased(two).empty());
}

}  // namespace
}  // namespace tessera::server
