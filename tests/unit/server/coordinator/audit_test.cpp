// Audits through the coordinator: a faulty worker is found and its units are rendered again.

#include <functional>
#include <string>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class AuditTest : public CoordinatorFixture {
 protected:
  /// Selects the units for which a worker delivers wrong pixels.
  using IsWrong = std::function<bool(const Leased&)>;
  static bool never(const Leased&) { return false; }
  static bool always(const Leased&) { return true; }

  AuditTest() { options.policy.audit_fraction = 1; }

  TestWorker& add(const std::string& id, IsWrong is_wrong = never) {
    workers_.push_back(join(id));
    is_wrong_.push_back(std::move(is_wrong));
    return workers_.back();
  }

  void deliver_leased_units() {
    for (std::size_t i = 0; i < workers_.size(); ++i) {
      TestWorker& worker = workers_[i];
      collect(worker);
      for (const Leased& unit : std::exchange(worker.units, {})) {
        if (has_ended(view(unit.name.job_id).state)) continue;
        std::string bytes = bytes_of(unit);
        if (is_wrong_[i](unit))
          bytes[2] = static_cast<char>(bytes[2] ^ 0x20);  // the first pixel's red
        deliver(worker, unit, bytes);
      }
      pump();
    }
  }

  /// The first of two workers delivers its units; then the second one, its only witness, leaves.
  void deliver_and_lose_second() {
    for (const Leased& unit : std::exchange(workers_[0].units, {})) {
      deliver(workers_[0], unit, bytes_of(unit));
    }
    pump();
    coordinator->workers().begin_draining(workers_[1].session);
    coordinator->workers().disconnect(workers_[1].session);
    workers_.pop_back();
  }

  void run_workers(const std::string& job_id) {
    for (int round = 0; round < 200 && !has_ended(view(job_id).state); ++round) {
      deliver_leased_units();
      keep_workers();
      pump();
    }
  }

  void keep_workers() {
    for (TestWorker& worker : workers_) coordinator->workers().grant_credits(worker.session, 4);
    now += std::chrono::milliseconds(100);
    for (TestWorker& worker : workers_) coordinator->workers().record_contact(worker.session);
    coordinator->tick();
  }

  /// Pixels of a job rendered by one correct worker without audits.
  std::string correct_pixels(const JobSpec& spec) {
    const double fraction = std::exchange(options.policy.audit_fraction, 0);
    start();
    JobSpec calm = spec;
    calm.name = calm.request = calm.request_id = "calm";
    const std::string job = create(calm)->view.spec->id;
    TestWorker worker = join("correct");
    finish_job(worker, job);
    options.policy.audit_fraction = fraction;
    start();
    return pixels_of(job);
  }

  JobSpec error_spec(const std::string& name) {
    noise = 0.3;
    JobSpec spec = spec_of(name, 4096);
    spec.settings.width = 40;
    spec.settings.height = 24;
    spec.settings.tile = 16;
    spec.settings.error = 0.1;
    return spec;
  }

  std::int64_t audited(const std::string& job) {
    return coordinator->queries().report(job)->counters.audited;
  }
  bool is_quarantined(const std::string& id) {
    for (const auto& [worker, silence] : coordinator->workers().list()) {
      if (worker.id == id) return worker.quarantined;
    }
    return false;
  }

  std::vector<TestWorker> workers_;
  std::vector<IsWrong> is_wrong_;
};

TEST_F(AuditTest, FrameWaitsUntilEveryUnitIsAudited) {
  const std::string job = create_job("a");
  add("w1");
  add("w2");
  deliver_leased_units();
  EXPECT_EQ(view(job).committed_unit_count, 6);
  EXPECT_EQ(view(job).state, JobState::running) << "no frame is finished before its audits";
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(audited(job), 6);
  EXPECT_EQ(coordinator->queries().report(job)->counters.mismatched, 0);
  EXPECT_FALSE(is_quarantined("w1") || is_quarantined("w2"));
  start();
  EXPECT_EQ(audited(job), 6) << "its units have no rows any more";
}

TEST_F(AuditTest, SingleWorkerIsNotAudited) {
  const std::string job = create_job("a");
  add("w1");
  deliver_leased_units();
  EXPECT_EQ(view(job).state, JobState::done) << "at once: there is no audit to waive";
  EXPECT_EQ(audited(job), 0);
}

TEST_F(AuditTest, AuditIsWaivedWithoutOtherWorkers) {
  const std::string job = create_job("a");
  add("w1");
  add("w2");
  coordinator->workers().grant_credits(workers_[0].session, 64);
  deliver_and_lose_second();
  now += std::chrono::seconds(6);
  coordinator->workers().record_contact(workers_[0].session);
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(AuditTest, FaultyWorkersUnitsAreRenderedAgain) {
  const std::string truth = correct_pixels(spec_of("a"));
  const std::string job = create_job("a");
  add("faulty", always);
  add("w2");
  add("w3");
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), truth);
  EXPECT_TRUE(is_quarantined("faulty"));
  EXPECT_FALSE(is_quarantined("w2") || is_quarantined("w3"));
  EXPECT_GE(coordinator->queries().report(job)->counters.redone, 1);
}

TEST_F(AuditTest, DecisionsOnFalseResultsAreRepeated) {
  const std::string truth = correct_pixels(error_spec("e"));
  const std::string job = create(error_spec("e"))->view.spec->id;
  workers_.push_back(join("faulty"));
  is_wrong_.emplace_back(always);
  add("w2");
  add("w3");
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), truth);
  EXPECT_TRUE(is_quarantined("faulty"));
}

TEST_F(AuditTest, SelfContradictingWorkerIsQuarantined) {
  const std::string truth = correct_pixels(spec_of("a"));
  const std::string job = create_job("a");
  int count = 0;
  add("w1");
  add("faulty", [&](const Leased&) { return ++count == 2; });
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), truth);
  EXPECT_TRUE(is_quarantined("faulty"));
  EXPECT_FALSE(is_quarantined("w1"));
}

TEST_F(AuditTest, UnresolvedDisputeFailsJob) {
  const std::string job = create_job("a");
  add("w1");
  add("faulty", always);
  run_workers(job);  // 20 seconds, in which a third worker might come
  EXPECT_EQ(view(job).state, JobState::running);
  for (int again = 0; again < 3; ++again) run_workers(job);
  EXPECT_EQ(view(job).state, JobState::failed);
  EXPECT_NE(view(job).reason.find("workers disagree"), std::string::npos) << view(job).reason;
}

TEST_F(AuditTest, OpenAuditSurvivesRestart) {
  const std::string job = create_job("a");
  add("w1");
  add("w2");
  deliver_leased_units();
  ASSERT_EQ(view(job).committed_unit_count, 6);
  workers_.clear();
  is_wrong_.clear();
  start();
  EXPECT_EQ(view(job).state, JobState::running);
  add("w1");
  add("w2");
  now += std::chrono::seconds(6);
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(audited(job), 6);
}

TEST_F(AuditTest, AuditsOfCancelledJobGoOnAfterRetry) {
  const std::string job = create_job("a");
  add("w1");
  add("w2");
  deliver_leased_units();
  ASSERT_EQ(view(job).committed_unit_count, 6);
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  ASSERT_TRUE(change(job, JobAdmin::Change::retry).ok());
  EXPECT_EQ(view(job).state, JobState::running) << "its audits are still open";
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(audited(job), 6);
}

TEST_F(AuditTest, WaitForOthersStartsAgainWithRetry) {
  const std::string job = create_job("a");
  add("w1");
  add("w2");
  deliver_and_lose_second();
  const auto pass = [&](int ticks) {
    for (int i = 0; i < ticks; ++i) {
      keep_workers();
      pump();
    }
  };
  pass(10);
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  pass(100);
  ASSERT_TRUE(change(job, JobAdmin::Change::retry).ok());
  pass(10);
  EXPECT_EQ(view(job).state, JobState::running) << "5 s have not passed since then";
  pass(100);
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(AuditTest, DisputeIsSettledAfterRetry) {
  const std::string truth = correct_pixels(spec_of("a"));
  const std::string job = create_job("a");
  add("w1");
  add("faulty", always);
  for (int again = 0; again < 4; ++again) run_workers(job);
  ASSERT_EQ(view(job).state, JobState::failed) << "nobody can settle it";
  add("w3");
  ASSERT_TRUE(change(job, JobAdmin::Change::retry).ok());
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), truth);
  EXPECT_TRUE(is_quarantined("faulty"));
}

TEST_F(AuditTest, UnitIsAuditedBeforeOthersAreBackAfterRestart) {
  const std::string job = create_job("a");
  add("w1");
  add("w2");
  const std::vector<Leased> units = workers_[0].units;
  ASSERT_EQ(units.size(), 6u);
  pump();  // writes the roster
  workers_.clear();
  is_wrong_.clear();
  start();
  add("w1");
  for (const Leased& unit : units) deliver(workers_[0], unit, bytes_of(unit));
  pump();
  EXPECT_EQ(view(job).committed_unit_count, 6);
  EXPECT_EQ(view(job).state, JobState::running) << "w2 may be back soon";
  add("w2");
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(audited(job), 6);
}

TEST_F(AuditTest, DisputeIsDurableBeforeResultIsRejected) {
  options.policy.audit_fraction = 1e-9;
  start();
  const std::string job = create_job("a");
  add("w1");
  deliver(workers_[0], workers_[0].units[0], bytes_of(workers_[0].units[0]));
  pump();
  collect(workers_[0]);
  workers_[0].acknowledgements.clear();
  std::string other = bytes_of(workers_[0].units[0]);
  other[2] = static_cast<char>(other[2] ^ 0x20);
  store.controls().fail_transactions_with(absl::ResourceExhaustedError("disk full"));
  deliver(workers_[0], workers_[0].units[0], other);
  pump();
  collect(workers_[0]);
  EXPECT_TRUE(workers_[0].acknowledgements.empty());
  store.controls().fail_transactions_with(absl::OkStatus());
  deliver(workers_[0], workers_[0].units[0], other);
  pump();
  collect(workers_[0]);
  ASSERT_EQ(workers_[0].acknowledgements.size(), 1u);
  EXPECT_EQ(workers_[0].acknowledgements[0].status, AckStatus::rejected);
  int open = 0;
  ASSERT_TRUE(
      store.units()
          .for_each(job,
                    [&](const UnitRecord& unit) { open += unit.audit == AuditState::open ? 1 : 0; })
          .ok());
  EXPECT_EQ(open, 1);
}

TEST_F(AuditTest, VerdictWaitsForFullDisk) {
  const std::string truth = correct_pixels(spec_of("a"));
  const std::string job = create_job("a");
  add("faulty", always);
  add("w2");
  add("w3");
  const auto fill = [&](bool is_full) {
    store.controls().fail_transactions_with(is_full ? absl::ResourceExhaustedError("disk full")
                                                    : absl::OkStatus());
  };
  for (int round = 0; round < 200 && !is_quarantined("faulty"); ++round) {
    for (std::size_t i = 0; i < workers_.size(); ++i) {
      collect(workers_[i]);
      for (const Leased& unit : std::exchange(workers_[i].units, {})) {
        std::string bytes = bytes_of(unit);
        if (i == 0) bytes[2] = static_cast<char>(bytes[2] ^ 0x20);
        deliver(workers_[i], unit, bytes);
      }
      while (!is_quarantined("faulty") && write_round()) {
      }
    }
    keep_workers();
  }
  ASSERT_TRUE(is_quarantined("faulty"));
  fill(true);
  pump();
  EXPECT_TRUE(store.workers().banned_workers()->empty());
  EXPECT_EQ(view(job).state, JobState::paused);
  fill(false);
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), truth);
  EXPECT_FALSE(store.workers().banned_workers()->empty());
}

TEST_F(AuditTest, FirstUnitOfWorkerIsAlwaysAudited) {
  options.policy.audit_fraction = 1e-9;
  start();
  add("w1");
  add("w2");
  const std::string job = create_job("a");
  run_workers(job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(coordinator->queries().report(job)->contributions.size(), 2u);
  EXPECT_EQ(audited(job), 2);
}

TEST_F(AuditTest, DoubtsOfFinishedFramesSurviveRestart) {
  bool is_faulty = false;
  const std::string done = create_job("done");
  add("faulty", [&](const Leased&) { return is_faulty; });
  run_workers(done);
  ASSERT_EQ(view(done).state, JobState::done);
  is_faulty = true;
  const std::string job = create_job("a");
  add("w2");
  add("w3");
  run_workers(job);
  ASSERT_TRUE(is_quarantined("faulty"));
  for (int restart = 0; restart < 2; ++restart) {
    const std::vector<std::string> warnings = coordinator->queries().report(done)->warnings;
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_NE(warnings[0].find("worker faulty"), std::string::npos) << warnings[0];
    start();
  }
}

TEST_F(AuditTest, QuarantineSurvivesReconnect) {
  const std::string job = create_job("a");
  add("faulty", always);
  add("w2");
  add("w3");
  run_workers(job);
  ASSERT_TRUE(is_quarantined("faulty"));
  TestWorker again = join("faulty");
  EXPECT_TRUE(is_quarantined("faulty"));
  create_job("b");
  collect(again);
  EXPECT_TRUE(again.units.empty());
}

TEST_F(AuditTest, SharedCertificateIsReportedOncePerJob) {
  int warnings = 0;
  options.log = [&](LogLevel level, const std::string& text) {
    if (text.find("units are not audited") == std::string::npos) return;
    ++warnings;
    EXPECT_EQ(level, LogLevel::warn);
    EXPECT_NE(text.find("its 2 workers share the certificate pods"), std::string::npos) << text;
  };
  start();
  now += std::chrono::seconds(10);  // no worker may be coming back
  TestWorker one = join("one", 64, "pods");
  finish_job(one, create_job("alone"));
  EXPECT_EQ(warnings, 0) << "a single worker audits nothing, whatever its certificate";
  TestWorker two = join("two", 64, "pods");
  const std::string job = create_job("a");
  finish_job(one, job);
  finish_job(two, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(warnings, 1);
  TestWorker other = join("other", 64, "elsewhere");
  const std::string audited = create_job("b");
  for (int round = 0; round < 9; ++round) {
    for (TestWorker* worker : {&one, &two, &other}) {
      coordinator->workers().grant_credits(worker->session, 4);
      collect(*worker);
      deliver_all(*worker);
      pump();
    }
  }
  EXPECT_EQ(view(audited).state, JobState::done);
  EXPECT_GT(coordinator->queries().report(audited)->counters.audited, 0);
  EXPECT_EQ(warnings, 1);
}

}  // namespace
}  // namespace tessera::server
