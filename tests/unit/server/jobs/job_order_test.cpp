// Dependencies, pools, limits, changes of jobs and the use of owners, over restarts.
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

using Kind = Dependency::Kind;
using namespace std::chrono_literals;

class JobOrderTest : public CoordinatorFixture {
 protected:
  std::string create_after(const std::string& name, const std::string& other, Kind kind) {
    JobSpec spec = spec_of(name);
    spec.after = {{other, kind}};
    const auto created = create(spec);
    EXPECT_TRUE(created.ok()) << created.status();
    return created.ok() ? created->view.spec->id : "";
  }
  absl::StatusOr<JobView> update(const std::string& job_id,
                                 const std::function<void(JobAdmin::Update&)>& edit) {
    JobAdmin::Update update;
    edit(update);
    absl::StatusOr<JobView> result = absl::UnknownError("no answer");
    coordinator->jobs().update_job(job_id, update, [&](const auto& view) { result = view; });
    pump();
    return result;
  }
  absl::Status set_limit(const std::string& name, std::int64_t units) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->settings().set_limit(name, units,
                                      [&](const auto& limit) { result = limit.status(); });
    pump();
    return result;
  }
  absl::Status move(const std::string& worker, const std::string& pool) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->settings().move_worker(worker, pool,
                                        [&](const absl::Status& status) { result = status; });
    pump();
    return result;
  }
  absl::Status create_status(const JobSpec& spec, const std::string& visible_owner = {}) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->admission().create_job(
        spec, [&](const auto& created) { result = created.status(); }, visible_owner);
    pump();
    return result;
  }
};

TEST_F(JobOrderTest, UnknownDependencyIsRefused) {
  JobSpec spec = spec_of("b");
  spec.after = {{"nobody", Kind::success}};
  const absl::Status status = create_status(spec);
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_EQ(status.message(), "dependencies: no job \"nobody\"");
}

TEST_F(JobOrderTest, DependencyOnAnotherOwnersJobIsRefused) {
  const std::string other = create_job("a");  // ann's
  JobSpec spec = spec_of("b");
  spec.owner = "ben";
  spec.after = {{other, Kind::end}};
  EXPECT_TRUE(absl::IsNotFound(create_status(spec, "ben")));
  EXPECT_TRUE(create(spec).ok()) << "an admin sees all jobs";
}

TEST_F(JobOrderTest, DependencyOnMissingFrameIsRefused) {
  const std::string other = create_job("a");  // frame 0
  JobSpec spec = spec_of("b");
  spec.settings.frames = {{0, 1, 1}};
  spec.after = {{other, Kind::frames}};
  const absl::Status status = create_status(spec);
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  EXPECT_EQ(status.message(), "dependencies: job " + other + " has no frame 1 to wait for");
}

TEST_F(JobOrderTest, DependencyOutlivesRestart) {
  const std::string first = create_job("a");
  const std::string second = create_after("b", first, Kind::success);
  start();
  EXPECT_EQ(view(second).reason, "waits for job " + first + " to be done; it is QUEUED");
  TestWorker worker = join("w");
  for (const Leased& unit : worker.units) EXPECT_EQ(unit.name.job_id, first);
  finish_job(worker, first);
  ASSERT_EQ(view(first).state, JobState::done);
  finish_job(worker, second);
  EXPECT_EQ(view(second).state, JobState::done);
}

TEST_F(JobOrderTest, RemovalAfterSuccessOutlivesRestart) {
  const std::string first = create_job("a");
  TestWorker worker = join("w");
  finish_job(worker, first);
  const std::string second = create_after("b", first, Kind::frames);
  ASSERT_TRUE(change(second, JobAdmin::Change::pause).ok());
  ASSERT_TRUE(remove(first).ok());
  start();
  ASSERT_TRUE(change(second, JobAdmin::Change::resume).ok());
  worker = join("w");
  finish_job(worker, second);
  EXPECT_EQ(view(second).state, JobState::done);
}

TEST_F(JobOrderTest, RemovalLongAgoWasAfterSuccess) {
  const std::string first = create_job("a");
  TestWorker worker = join("w");
  finish_job(worker, first);
  const std::string second = create_after("b", first, Kind::success);
  ASSERT_TRUE(change(second, JobAdmin::Change::pause).ok());
  ASSERT_TRUE(remove(first).ok());
  store.controls().forget_removed_jobs();
  start();
  ASSERT_TRUE(change(second, JobAdmin::Change::resume).ok());
  worker = join("w");
  finish_job(worker, second);
  EXPECT_EQ(view(second).state, JobState::done);
}

TEST_F(JobOrderTest, RemovalBeforeSuccessFailsDependent) {
  const std::string first = create_job("a");
  const std::string second = create_after("b", first, Kind::success);
  ASSERT_TRUE(change(first, JobAdmin::Change::cancel).ok());
  ASSERT_TRUE(remove(first).ok());
  EXPECT_EQ(view(second).state, JobState::failed);
  EXPECT_EQ(view(second).failure_code, absl::StatusCode::kFailedPrecondition);
  start();
  EXPECT_EQ(view(second).state, JobState::failed) << "it is durable";
  EXPECT_TRUE(absl::IsFailedPrecondition(change(second, JobAdmin::Change::retry).status()));
  ASSERT_TRUE(update(second, [](auto& update) { update.clear_dependencies = true; }).ok());
  ASSERT_TRUE(change(second, JobAdmin::Change::retry).ok());
  TestWorker worker = join("w");
  finish_job(worker, second);
  EXPECT_EQ(view(second).state, JobState::done);
}

TEST_F(JobOrderTest, CrashAfterRemovalFailsDependent) {
  const std::string first = create_job("a");
  const std::string second = create_after("b", first, Kind::success);
  ASSERT_TRUE(change(first, JobAdmin::Change::cancel).ok());
  ASSERT_TRUE(
      store.jobs().remove(first).ok());  // the crash comes before the dependent's row is written
  start();
  EXPECT_EQ(view(second).state, JobState::failed);
}

TEST_F(JobOrderTest, UpdateOutlivesRestart) {
  ASSERT_TRUE(set_limit("licence", 4).ok());
  const std::string job = create_job("a");
  const auto changed = update(job, [](auto& update) {
    update.priority = 7;
    update.max_workers = 3;
    update.required_tag = "gpu";
    update.pool = "night";
    update.limits = std::vector<LimitUse>{{"licence", 2}};
  });
  ASSERT_TRUE(changed.ok()) << changed.status();
  start();
  const JobSpec& spec = *view(job).spec;
  EXPECT_EQ(spec.priority, 7);
  EXPECT_EQ(spec.max_workers, 3);
  EXPECT_EQ(spec.required_tag, "gpu");
  EXPECT_EQ(spec.pool, "night");
  EXPECT_EQ(spec.limits, (std::vector<LimitUse>{{"licence", 2}}));
}

TEST_F(JobOrderTest, UpdateThatIsNotWrittenChangesNothing) {
  const std::string job = create_job("a");
  store.controls().fail_commits_with(absl::ResourceExhaustedError("full"));
  EXPECT_TRUE(
      absl::IsResourceExhausted(update(job, [](auto& update) { update.priority = 7; }).status()));
  EXPECT_EQ(view(job).spec->priority, 0);
  store.controls().fail_commits_with(absl::OkStatus());
  EXPECT_TRUE(
      absl::IsNotFound(update("nobody", [](auto& update) { update.priority = 7; }).status()));
}

TEST_F(JobOrderTest, DoneJobCannotBeUpdated) {
  const std::string job = create_job("a");
  TestWorker worker = join("w");
  finish_job(worker, job);
  EXPECT_TRUE(
      absl::IsFailedPrecondition(update(job, [](auto& update) { update.priority = 7; }).status()));
}

TEST_F(JobOrderTest, UnknownLimitIsRefused) {
  JobSpec spec = spec_of("a");
  spec.limits = {{"licence", 1}};
  const absl::Status status = create_status(spec);
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_EQ(status.message(),
            "limits: no limit \"licence\"; an operator creates it with `tessera limits set licence "
            "N`");
}

TEST_F(JobOrderTest, UseAboveTotalOfLimitIsRefused) {
  ASSERT_TRUE(set_limit("licence", 2).ok());
  JobSpec spec = spec_of("a");
  spec.limits = {{"licence", 3}};
  const absl::Status status = create_status(spec);
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  EXPECT_EQ(status.message(),
            "limits: limit licence has 2 units, each unit of work of this job needs 3; use at most "
            "2, or ask the operator to raise the limit");
  const std::string job = create_job("b");
  const auto use = [](std::int32_t units) {
    return [units](auto& update) { update.limits = std::vector<LimitUse>{{"licence", units}}; };
  };
  EXPECT_TRUE(absl::IsInvalidArgument(update(job, use(3)).status()));
  EXPECT_TRUE(update(job, use(2)).ok());
}

TEST_F(JobOrderTest, JobSaysThatLimitIsTooLowForIt) {
  ASSERT_TRUE(set_limit("licence", 2).ok());
  JobSpec spec = spec_of("a");
  spec.limits = {{"licence", 2}};
  const std::string job = create(spec)->view.spec->id;
  ASSERT_TRUE(set_limit("licence", 1).ok());
  TestWorker worker = join("w");
  EXPECT_TRUE(worker.units.empty());
  EXPECT_EQ(view(job).reason,
            "limit licence has 1 unit, a lease needs 2; `tessera limits set` "
            "raises the limit, `tessera set " +
                job + " --limit` changes the job");
}

TEST_F(JobOrderTest, LimitOutlivesRestart) {
  ASSERT_TRUE(set_limit("licence", 2).ok());
  JobSpec spec = spec_of("a");
  spec.limits = {{"licence", 1}};
  ASSERT_TRUE(create(spec).ok());
  start();
  TestWorker worker = join("w");
  EXPECT_EQ(worker.units.size(), 2u);
  ASSERT_EQ(coordinator->settings().limits().size(), 1u);
  EXPECT_EQ(coordinator->settings().limits()[0].used, 2);
  absl::Status removed = absl::UnknownError("no answer");
  coordinator->settings().remove_limit("licence", [&](const absl::Status& s) { removed = s; });
  pump();
  EXPECT_TRUE(removed.ok());
  EXPECT_TRUE(coordinator->settings().limits().empty());
  start();
  EXPECT_TRUE(coordinator->settings().limits().empty());
}

TEST_F(JobOrderTest, LimitThatIsNotWrittenHasNoEffect) {
  store.controls().fail_commits_with(absl::ResourceExhaustedError("full"));
  EXPECT_TRUE(absl::IsResourceExhausted(set_limit("licence", 2)));
  EXPECT_TRUE(coordinator->settings().limits().empty());
}

TEST_F(JobOrderTest, PoolOfMovedWorkerOutlivesRestart) {
  join("w");
  ASSERT_TRUE(move("w", "night").ok());
  EXPECT_TRUE(absl::IsNotFound(move("nobody", "night")));
  start();
  const std::string day = create_job("a");
  JobSpec spec = spec_of("b");
  spec.pool = "night";
  const auto night = create(spec);
  ASSERT_TRUE(night.ok());
  const TestWorker worker = join("w");
  ASSERT_FALSE(worker.units.empty());
  for (const Leased& unit : worker.units) EXPECT_EQ(unit.name.job_id, night->view.spec->id);
  EXPECT_EQ(view(day).reason, "no connected worker is in pool default");
}

TEST_F(JobOrderTest, UseOfOwnersOutlivesCrash) {
  const std::string of_ann = create_job("a");
  TestWorker worker = join("w");
  finish_job(worker, of_ann);
  now += 30s;
  coordinator->tick();
  pump();
  start();  // the process before was not stopped
  const std::string again = create_job("c");
  JobSpec spec = spec_of("b");
  spec.owner = "ben";
  const auto of_ben = create(spec);
  ASSERT_TRUE(of_ben.ok());
  const TestWorker other = join("w", 1);
  ASSERT_EQ(other.units.size(), 1u);
  EXPECT_EQ(other.units[0].name.job_id, of_ben->view.spec->id)
      << "the client with less past use goes first";
  EXPECT_EQ(view(again).reason, "another client has used less and goes first");
}

}  // namespace
}  // namespace tessera::server
