// Budgets, jobs that failures pause, and workers that are set aside, over restarts.
#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

const Account client_ann{AccountScope::owner, "ann"}, film{AccountScope::project, "film"};

class Accounts : public CoordinatorFixture {
 protected:
  absl::StatusOr<Budgets::Entry> set(const Account& account, const Budget& budget) {
    absl::StatusOr<Budgets::Entry> result = absl::UnknownError("no answer");
    coordinator->budgets().set(account, budget, [&](const auto& entry) { result = entry; });
    pump();
    return result;
  }
  absl::Status remove(const Account& account) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->budgets().remove(account, [&](const absl::Status& status) { result = status; });
    pump();
    return result;
  }
  BudgetState state_of(const Account& account) {
    for (const auto& [found, state] : coordinator->budgets().list("")) {
      if (found == account) return state;
    }
    return {};
  }
  std::int64_t count(EventKind kind) {
    pump();
    const auto events = coordinator->farm().events().read({}, 100'000);
    return std::count_if(events.begin(), events.end(),
                         [&](const Event& event) { return event.kind == kind; });
  }
  /// Delivers a number of the worker's units; each takes 0.5 s.
  void deliver_some(TestWorker& worker, std::size_t units) {
    collect(worker);
    for (std::size_t i = 0; i < units && !worker.units.empty(); ++i) {
      deliver(worker, worker.units.front(), bytes_of(worker.units.front()));
      worker.units.erase(worker.units.begin());
    }
    pump();
    collect(worker);
  }
};

// Budgets -----------------------------------------------------------------------------------------

TEST_F(Accounts, UsedUpBudgetStopsLeasesAndTellsOnce) {
  TestWorker worker = join("w", 2);
  const std::string job = create_job("shot");  // 6 units
  ASSERT_TRUE(set(client_ann, {1.5, BudgetPeriod::ever, BudgetAction::stop, 0.5}).ok());
  deliver_some(worker, 2);
  EXPECT_EQ(count(EventKind::budget_warning), 1);
  coordinator->workers().grant_credits(worker.session, 2);
  deliver_some(worker, 2);
  EXPECT_EQ(state_of(client_ann).used_cpu_seconds, 2.0);
  EXPECT_EQ(count(EventKind::budget_used_up), 1);
  coordinator->workers().grant_credits(worker.session, 2);
  collect(worker);
  EXPECT_TRUE(worker.units.empty());
  EXPECT_TRUE(absl::StartsWith(view(job).reason, "budget of client ann: ")) << view(job).reason;
  start();
  EXPECT_EQ(state_of(client_ann).used_cpu_seconds, 2.0);
  EXPECT_EQ(count(EventKind::budget_used_up), 1) << "also over a restart";
  EXPECT_EQ(count(EventKind::budget_warning), 1);
  worker = join("w");
  EXPECT_TRUE(worker.units.empty());
  ASSERT_TRUE(set(client_ann, {100, BudgetPeriod::ever, BudgetAction::stop, 0.5}).ok());
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(state_of(client_ann).used_cpu_seconds, 3.0);
  EXPECT_TRUE(remove(client_ann).ok());
  EXPECT_TRUE(absl::IsNotFound(remove(client_ann)));
}

TEST_F(Accounts, ProjectBudgetCountsWhatWasUsedBefore) {
  TestWorker worker = join("w");
  JobSpec spec = spec_of("shot");
  spec.project = "film";
  const std::string job = create(spec)->view.spec->id;
  finish_job(worker, job);
  const auto entry = set(film, {2, BudgetPeriod::ever, BudgetAction::stop, 0.8});
  ASSERT_TRUE(entry.ok());
  EXPECT_EQ(entry->second.used_cpu_seconds, 3.0);
  EXPECT_EQ(count(EventKind::budget_used_up), 1);
  spec = spec_of("next");
  spec.project = "film";
  const std::string next = create(spec)->view.spec->id;
  collect(worker);
  EXPECT_TRUE(worker.units.empty());
  EXPECT_FALSE(create_job("other").empty());
  collect(worker);
  EXPECT_FALSE(worker.units.empty()) << "jobs of no project go on";
  EXPECT_TRUE(absl::StartsWith(view(next).reason, "budget of project film: "));
}

TEST_F(Accounts, DuplicatesAndRestartsChargeNothing) {
  ASSERT_TRUE(set(client_ann, {100, BudgetPeriod::ever, BudgetAction::warn, 0.8}).ok());
  TestWorker worker = join("w");
  const std::string job = create_job("shot");
  collect(worker);
  const std::vector<Leased> units = worker.units;
  for (int again = 0; again < 2; ++again) {
    for (std::size_t i = 0; i < 3; ++i) deliver(worker, units[i], bytes_of(units[i]));
    pump();
  }
  EXPECT_EQ(state_of(client_ann).used_cpu_seconds, 1.5);
  start();
  worker = join("w");
  for (std::size_t i = 0; i < 3; ++i) deliver(worker, units[i], bytes_of(units[i]));
  pump();
  EXPECT_EQ(state_of(client_ann).used_cpu_seconds, 1.5);
  const auto used = coordinator->queries().usage({.by_job = true}, 10);
  ASSERT_EQ(used->size(), 1u);
  EXPECT_EQ(used->front().units, 3);
  EXPECT_EQ(used->front().cpu_seconds, view(job).cpu_seconds);
}

TEST_F(Accounts, NewPeriodStartsFromZero) {
  wall_us = 1'764'100'000'000'000;  // 2025-11-25
  store.units().set_hour(wall_us / kHourUs);
  ASSERT_TRUE(set(client_ann, {1, BudgetPeriod::day, BudgetAction::stop, 0.8}).ok());
  TestWorker worker = join("w", 2);
  create_job("shot");
  deliver_some(worker, 2);
  coordinator->workers().grant_credits(worker.session, 2);
  collect(worker);
  EXPECT_TRUE(worker.units.empty());
  wall_us += 24 * kHourUs;
  now += std::chrono::seconds(1);
  coordinator->tick();
  EXPECT_EQ(state_of(client_ann).used_cpu_seconds, 0);
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
}

// Failures ----------------------------------------------------------------------------------------

TEST_F(Accounts, PauseByFailuresOutlivesRestartAndRetryEndsIt) {
  options.policy.audit_fraction = 0;
  start();
  const std::string job = create_job("shot");
  std::vector<TestWorker> workers;
  for (const char* id : {"w1", "w2"}) workers.push_back(join(id, 1));
  for (int round = 0; round < 20 && view(job).state == JobState::running; ++round) {
    for (TestWorker& worker : workers) {
      collect(worker);
      for (const Leased& unit : std::exchange(worker.units, {})) {
        if (unit.name.unit.tile == 2) {
          coordinator->workers().fail_unit(worker.session, unit.lease, unit.name.unit.tile,
                                           {"", "out of luck", "log"}, absl::StatusCode::kInternal);
        } else {
          deliver(worker, unit, bytes_of(unit));
        }
        pump();
        coordinator->workers().grant_credits(worker.session, 1);
      }
    }
  }
  const auto check = [&] {
    const JobView paused = view(job);
    EXPECT_EQ(paused.state, JobState::paused);
    EXPECT_EQ(paused.pause_cause, PauseCause::failures);
    EXPECT_EQ(paused.failure_code, absl::StatusCode::kInternal);
    EXPECT_TRUE(absl::StrContains(paused.reason, "out of luck")) << paused.reason;
    ASSERT_EQ(paused.failed_attempts.size(), 3u);
    EXPECT_EQ(paused.failed_attempts[0].unit.tile, 2);
    EXPECT_EQ(paused.failed_attempts[0].message, "out of luck");
  };
  check();
  EXPECT_EQ(count(EventKind::job_paused_by_failures), 1);
  EXPECT_EQ(count(EventKind::job_paused), 0);
  start();
  check();
  EXPECT_EQ(count(EventKind::job_paused_by_failures), 1);
  const auto retried = change(job, JobAdmin::Change::retry);
  ASSERT_TRUE(retried.ok()) << retried.status();
  EXPECT_EQ(retried->pause_cause, PauseCause::none);
  EXPECT_TRUE(retried->failed_attempts.empty());
  start();
  EXPECT_TRUE(view(job).failed_attempts.empty());
  TestWorker good = join("good");
  join("w1", 0);
  join("w2", 0);  // the farm waits for those that it knows
  finish_job(good, job);
  EXPECT_EQ(view(job).state, JobState::done);
}

// Workers -----------------------------------------------------------------------------------------

TEST_F(Accounts, SetAsideOutlivesRestart) {
  const auto order = [&](bool aside, const std::string& worker) {
    absl::Status result = absl::UnknownError("no answer");
    const auto done = [&](const absl::Status& status) { result = status; };
    if (aside) {
      coordinator->settings().set_aside(worker, "why", done);
    } else {
      coordinator->settings().bring_back(worker, done);
    }
    pump();
    return result;
  };
  TestWorker worker = join("w");
  EXPECT_TRUE(absl::IsNotFound(order(true, "nobody")));
  EXPECT_TRUE(absl::IsNotFound(order(false, "nobody")));
  ASSERT_TRUE(order(true, "w").ok());
  create_job("shot");
  collect(worker);
  EXPECT_TRUE(worker.units.empty());
  EXPECT_EQ(count(EventKind::worker_set_aside), 1);
  start();
  worker = join("w");
  EXPECT_TRUE(worker.units.empty());
  EXPECT_EQ(coordinator->workers().list().at(0).first.note, "why");
  ASSERT_TRUE(order(false, "w").ok());
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
  EXPECT_EQ(count(EventKind::worker_brought_back), 1);
  start();
  EXPECT_FALSE(join("w").units.empty());
}

TEST_F(Accounts, BlockedWorkerOutlivesRestart) {
  TestWorker worker = join("w", 0);
  const std::string job = create_job("shot");
  JobAdmin::Update update;
  update.block_workers = {"w", "x"};
  absl::StatusOr<JobView> changed = absl::UnknownError("no answer");
  coordinator->jobs().update_job(job, update, [&](const auto& view) { changed = view; });
  pump();
  ASSERT_TRUE(changed.ok()) << changed.status();
  start();
  EXPECT_EQ(view(job).spec->blocked_workers, (std::set<std::string>{"w", "x"}));
  worker = join("w");
  EXPECT_TRUE(worker.units.empty());
  update.block_workers.clear();
  update.unblock_workers = {"w"};
  coordinator->jobs().update_job(job, update, [&](const auto& view) { changed = view; });
  pump();
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
}

}  // namespace
}  // namespace tessera::server
