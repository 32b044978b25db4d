// Failures, audits and bans count by witness: one worker, or one certificate, decides nothing
// alone.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

// Failures ----------------------------------------------------------------------------------------

TEST(Witness, OneWorkersFailuresDoNotFailJob) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey bad = farm.connect("bad", {.threads = 1, .credits = 8});
  const auto unit = farm.leased(bad).at(0);
  const WorkerKey good = farm.connect("good", {.threads = 1, .credits = 1});
  for (int i = 0; i < 5; ++i) farm.fail(bad, unit);  // under one lease, which it has lost
  EXPECT_EQ(job.state, JobState::running);
  EXPECT_EQ(job.unit_failures.at(unit.unit).failures.size(), 1u);
  ASSERT_EQ(farm.leased(good), std::vector<UnitName>{unit});
  farm.commit(good, unit);
  farm.scheduler.results().finish_frame(job, 0, farm.now);
  EXPECT_EQ(job.state, JobState::done);
}

TEST(Witness, FailureOfUnitNotHeldIsIgnored) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 4});
  const WorkerKey worker = farm.connect("w1", {.threads = 2, .credits = 4});
  const auto units = farm.leased(worker);
  farm.scheduler.connections().return_units(worker, {units[0]}, farm.now);
  const WorkerKey other = farm.connect("w2", {.threads = 2, .credits = 4});
  ASSERT_EQ(farm.leased(other).at(0), units[0]);
  farm.fail(worker, units[0], absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(job.unit_failures.empty());
  EXPECT_TRUE(job.scene_faults.empty());
}

TEST(Witness, IdsOfOneCertificateFailAsOne) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  std::vector<WorkerKey> twins;
  for (const char* id : {"a", "b", "c"}) {
    twins.push_back(farm.connect(id, {.threads = 1, .credits = 1, .certificate = "one"}));
  }
  const auto unit = farm.leased(twins[0]).at(0);
  const WorkerKey honest = farm.connect("honest", {.threads = 1, .certificate = "two"});
  farm.fail(twins[0], unit);
  EXPECT_TRUE(farm.leased(twins[1]).empty());
  EXPECT_TRUE(farm.leased(twins[2]).empty());
  EXPECT_EQ(farm.leased(honest), std::vector<UnitName>{unit});
  EXPECT_EQ(job.state, JobState::running);
}

TEST(Witness, IndependentWorkersPauseJob) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 1});
  const WorkerKey two = farm.connect("w2", {.threads = 1, .credits = 1});
  for (int i = 0; i < 3 && job.state == JobState::running; ++i) {
    for (const WorkerKey key : {one, two}) {
      for (const UnitName& unit : farm.leased(key)) farm.fail(key, unit);
    }
  }
  EXPECT_TRUE(job.is_paused_by_failures());
  EXPECT_NE(job.reason.find("worker w1: broke"), std::string::npos);
  EXPECT_NE(job.reason.find("worker w2: broke"), std::string::npos);
}

TEST(Witness, LoneWorkersFailureSaysSo) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  int tries = 0;
  while (job.state == JobState::running && tries < 10) {
    for (const UnitName& unit : farm.leased(worker)) farm.fail(worker, unit);
    ++tries;
  }
  EXPECT_EQ(tries, 3);
  EXPECT_NE(job.reason.find("there is no other worker to confirm it"), std::string::npos);
}

TEST(Witness, BadSceneNeedsSecondWitness) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 8});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 2});
  const auto units = farm.leased(one);
  const WorkerKey two = farm.connect("w2", {.threads = 1, .credits = 1});
  const auto others = farm.leased(two);
  farm.fail(one, units[0], absl::StatusCode::kNotFound);
  EXPECT_EQ(job.state, JobState::running);
  EXPECT_TRUE(farm.leased(one).empty()) << "it gets no more units of this frame";
  farm.fail(two, others.at(0), absl::StatusCode::kNotFound);
  EXPECT_EQ(job.state, JobState::failed);
  EXPECT_EQ(job.reason, "bad scene: broke");
}

TEST(Witness, DisprovedBadSceneCountsAgainstWorker) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1, .frames = 3});
  const WorkerKey bad = farm.connect("bad", {.threads = 3, .credits = 3});
  const auto units = farm.leased(bad);
  ASSERT_EQ(units.size(), 3u);
  const WorkerKey good = farm.connect("good", {.threads = 3, .credits = 0});
  for (const UnitName& unit : units) farm.fail(bad, unit, absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(job.state, JobState::running);
  farm.scheduler.connections().grant_credits(good, 1, farm.now);
  for (int i = 0; i < 3; ++i) {
    for (const UnitName& unit : farm.leased(good)) farm.complete(good, unit);
  }
  EXPECT_TRUE(farm.scheduler.workers().find(bad)->quarantined);
  EXPECT_TRUE(job.scene_faults.empty());
}

TEST(Witness, SecondWitnessThatLeavesEndsTheWait) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey one = farm.connect("w1", {.threads = 1, .credits = 2});
  const auto unit = farm.leased(one).at(0);
  const WorkerKey two = farm.connect("w2", {.threads = 1, .credits = 0});
  farm.fail(one, unit, absl::StatusCode::kNotFound);
  EXPECT_EQ(farm.scheduler.waiting().wait_reason(job), WaitReason::other_worker);
  farm.pass(6s, {one});
  ASSERT_TRUE(farm.scheduler.workers().find(two)->lost);
  EXPECT_TRUE(farm.leased(one).empty()) << "the other one may come back";
  farm.pass(1min, {one});
  ASSERT_EQ(farm.leased(one), std::vector<UnitName>{unit});
  farm.fail(one, unit, absl::StatusCode::kNotFound);
  EXPECT_EQ(job.state, JobState::failed);
}

TEST(Witness, FirstWorkerAfterRestartFailsNoJob) {
  SchedulerHarness farm({"bad", "good"});
  Job& job = farm.add_job({.tiles = 1});
  Lease lease{"j1", 0, 0, 0, 1, 0, 8, {1, 77}, {}};
  lease.seal = make_seal(lease, "bad", "key");
  const UnitName unit{"j1", {0, 0, 0}};
  const WorkerKey bad = farm.connect("bad", {.leases = {lease}, .running = {unit}});
  farm.leases[{bad, unit}] = lease;
  farm.fail(bad, unit, absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(job.state, JobState::running);
  const WorkerKey good = farm.connect("good");
  EXPECT_EQ(farm.leased(good), std::vector<UnitName>{unit});
}

TEST(Witness, LossesOfOneWorkerDoNotFailJob) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey good = farm.connect("good", {.threads = 1, .credits = 0});
  int losses = 0;
  for (; losses < 20; ++losses) {
    const WorkerKey flaky = farm.connect("flaky", {.threads = 1, .credits = 1});
    const auto units = farm.leased(flaky);
    if (units.empty()) break;
    farm.pass(5200ms, {good});
  }
  EXPECT_EQ(losses, 3) << "then others go first";
  EXPECT_EQ(job.state, JobState::running);
  farm.scheduler.connections().grant_credits(good, 1, farm.now);
  EXPECT_EQ(farm.leased(good).size(), 1u);
}

TEST(Witness, FailuresAcrossJobsSetWorkerAside) {
  SchedulerHarness farm;
  const WorkerKey bad = farm.connect("bad", {.threads = 1, .credits = 1});
  std::vector<Job*> jobs;
  for (int i = 0; i < 3; ++i) jobs.push_back(&farm.add_job({.tiles = 1, .priority = 3 - i}));
  const WorkerKey good = farm.connect("good", {.threads = 1, .credits = 0});
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(farm.scheduler.workers().find(bad)->quarantined) << i << " jobs";
    farm.fail(bad, farm.leased(bad).at(0));
  }
  EXPECT_TRUE(farm.scheduler.workers().find(bad)->quarantined);
  farm.pass(9min, {bad, good});
  EXPECT_TRUE(farm.scheduler.workers().find(bad)->quarantined);
  farm.pass(2min, {bad, good});
  EXPECT_FALSE(farm.scheduler.workers().find(bad)->quarantined);
}

TEST(Witness, BrokenJobsDoNotSetWorkersAside) {
  SchedulerHarness farm;
  std::vector<WorkerKey> workers;
  for (const char* id : {"w1", "w2"}) {
    workers.push_back(farm.connect(id, {.threads = 1, .credits = 1}));
  }
  for (int i = 0; i < 5; ++i) farm.add_job({.tiles = 1});
  for (int round = 0; round < 40; ++round) {
    for (const WorkerKey key : workers) {
      for (const UnitName& unit : farm.leased(key)) farm.fail(key, unit);
    }
  }
  for (const auto& [key, job] : farm.scheduler.jobs().all())
    EXPECT_TRUE(job.is_paused_by_failures());
  for (const WorkerKey key : workers) EXPECT_FALSE(farm.scheduler.workers().find(key)->quarantined);
}

// Audits and bans ---------------------------------------------------------------------------------

TEST(Witness, CertificateCannotConfirmItsOwnResult) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey faulty =
      farm.connect("faulty", {.threads = 1, .credits = 1, .certificate = "one"});
  const auto unit = farm.leased(faulty).at(0);
  const WorkerKey twin = farm.connect("twin", {.threads = 1, .credits = 1, .certificate = "one"});
  EXPECT_FALSE(farm.scheduler.audits().wants_audit(job, unit.unit, "faulty", farm.now))
      << "nobody else could decide";
  const WorkerKey honest = farm.connect("honest", {.threads = 1, .credits = 1});
  farm.commit(faulty, unit);
  farm.scheduler.audits().open_audit(job, unit.unit, "faulty", wrong);
  farm.pass(200ms, {faulty, twin, honest});
  EXPECT_TRUE(farm.leased(twin).empty());
  EXPECT_EQ(farm.leased(honest), std::vector<UnitName>{unit});
}

TEST(Witness, CertificateCannotOutvoteHonestWorker) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  const WorkerKey faulty =
      farm.connect("faulty", {.threads = 1, .credits = 1, .certificate = "one"});
  const auto unit = farm.leased(faulty).at(0);
  const WorkerKey honest = farm.connect("honest", {.threads = 1, .credits = 1, .certificate = "h"});
  farm.commit(faulty, unit);
  farm.scheduler.audits().open_audit(job, unit.unit, "faulty", wrong);
  farm.pass(100ms, {faulty, honest});
  ASSERT_EQ(farm.leased(honest).size(), 1u);
  const auto answer = [&](WorkerKey worker, const contract::Digest& digest) {
    const std::string id = farm.scheduler.workers().find(worker)->id;
    farm.scheduler.audits().answer_audit(job, unit.unit, farm.leases.at({worker, unit}),
                                         {id, digest}, {"faulty", wrong}, farm.now);
  };
  answer(honest, truth);
  const WorkerKey third = farm.connect("third", {.threads = 1, .credits = 0, .certificate = "t"});
  const WorkerKey twin = farm.connect("twin", {.threads = 1, .credits = 1, .certificate = "one"});
  EXPECT_TRUE(farm.leased(twin).empty()) << "its certificate has answered";
  farm.leases[{twin, unit}] = farm.leases.at({honest, unit});
  answer(twin, wrong);
  EXPECT_FALSE(farm.scheduler.quarantine().is_quarantined("honest"));
  farm.scheduler.connections().grant_credits(third, 1, farm.now);
  ASSERT_EQ(farm.leased(third).size(), 1u);
  answer(third, truth);
  EXPECT_FALSE(farm.scheduler.quarantine().is_quarantined("honest"));
  EXPECT_TRUE(farm.scheduler.quarantine().is_quarantined("faulty"));
  EXPECT_TRUE(farm.scheduler.quarantine().is_quarantined("twin"));
  const auto effects = farm.scheduler.take_effects();
  EXPECT_EQ(effects.faulty_workers, (std::vector<std::string>{"faulty", "twin"}));
}

TEST(Witness, BanHoldsForCertificate) {
  SchedulerHarness farm;
  farm.add_job({.tiles = 40});
  const WorkerKey worker = farm.connect("w1", {.certificate = "one"});
  EXPECT_FALSE(farm.leased(worker).empty());
  const auto names = farm.scheduler.quarantine().names_to_ban("w1");
  farm.scheduler.quarantine().ban("w1");
  const WorkerKey again = farm.connect("w2", {.certificate = "one"});
  EXPECT_TRUE(farm.leased(again).empty());
  EXPECT_TRUE(farm.scheduler.quarantine().is_quarantined("w2"));

  SchedulerHarness restarted;
  restarted.add_job({.tiles = 40});
  for (const std::string& name : names) restarted.scheduler.quarantine().ban(name);
  const WorkerKey third = restarted.connect("w3", {.certificate = "one"});
  EXPECT_TRUE(restarted.leased(third).empty());
  EXPECT_FALSE(restarted.leased(restarted.connect("w4", {.certificate = "two"})).empty());

  EXPECT_TRUE(farm.scheduler.orders().allow("w2", farm.now));
  EXPECT_FALSE(farm.scheduler.workers().find(again)->quarantined);
  EXPECT_FALSE(farm.leased(again).empty());
}

// Outbox ------------------------------------------------------------------------------------------

TEST(Witness, FullOutboxClosesWorker) {
  SchedulePolicy policy;
  policy.max_outbox = 100;
  SchedulerHarness farm({}, policy);
  farm.add_job({.tiles = 4});
  const WorkerKey worker = farm.connect("w1");
  const UnitName unit = farm.leased(worker).at(0);
  for (int i = 0; i < 1000; ++i) {
    farm.scheduler.connections().acknowledge(worker, {unit, AckStatus::duplicate, ""});
  }
  EXPECT_FALSE(farm.scheduler.workers().find(worker)->connected);
  EXPECT_LE(farm.scheduler.workers().find(worker)->outbox.size(), policy.max_outbox);
  EXPECT_EQ(farm.scheduler.take_effects().to_close_unread, std::vector<WorkerKey>{worker});
  EXPECT_EQ(farm.connect("w1"), worker);
  EXPECT_TRUE(farm.scheduler.workers().find(worker)->connected);
}

}  // namespace
}  // namespace tessera::server
