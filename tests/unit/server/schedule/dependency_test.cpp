// Jobs that wait for other jobs, as a whole or frame by frame.
#include <gtest/gtest.h>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using Kind = Dependency::Kind;

/// Renders all that the worker is leased; finishes the frames of the job.
void render(SchedulerHarness& farm, WorkerKey worker, Job& job) {
  for (auto units = farm.leased(worker); !units.empty(); units = farm.leased(worker)) {
    for (const UnitName& unit : units) farm.complete(worker, unit);
  }
  for (const std::int32_t frame : job.plan->shape().frames) {
    if (job.plan->is_complete(frame)) farm.scheduler.results().finish_frame(job, frame, farm.now);
  }
}

TEST(Dependency, JobWaitsUntilOtherIsDone) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.credits = 100});
  Job& first = farm.add_job({.tiles = 4});
  Job& second = farm.add_job({.tiles = 4, .after = {{first.spec->id, Kind::success}}});
  EXPECT_EQ(farm.scheduler.waiting().wait_text(second),
            "waits for job j1 to be done; it is RUNNING");
  for (const UnitName& unit : farm.leased(worker)) {
    EXPECT_EQ(unit.job_id, first.spec->id);
    farm.complete(worker, unit);
  }
  EXPECT_TRUE(farm.leased(worker).empty()) << "no frame of the first job is finished";
  farm.scheduler.results().finish_frame(first, 0, farm.now);
  EXPECT_EQ(farm.leased(worker).size(), 4u);
  EXPECT_EQ(second.state, JobState::running);
  EXPECT_EQ(farm.scheduler.waiting().wait_text(second), "");
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(Dependency, FailureOfOtherBlocksUntilRetry) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.credits = 100});
  Job& first = farm.add_job({.tiles = 1});
  Job& second = farm.add_job({.tiles = 1, .after = {{first.spec->id, Kind::success}}});
  farm.scheduler.lifecycle().fail_job(first, absl::InternalError("broke"), farm.now);
  EXPECT_EQ(second.state, JobState::queued);
  EXPECT_EQ(farm.scheduler.waiting().wait_text(second),
            "waits for job j1, which is FAILED: `tessera retry j1` resumes it, `tessera set j2 "
            "--no-after` drops the dependency");
  farm.leased(worker);
  ASSERT_TRUE(farm.scheduler.lifecycle().retry(first, farm.now).ok());
  farm.scheduler.connections().grant_credits(worker, 1, farm.now);
  render(farm, worker, first);
  EXPECT_EQ(first.state, JobState::done);
  EXPECT_EQ(farm.leased(worker).size(), 1u);
}

TEST(Dependency, AnyEndOfOtherReleasesJob) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.credits = 100});
  Job& first = farm.add_job({.tiles = 1});
  const Job& second = farm.add_job({.tiles = 1, .after = {{first.spec->id, Kind::end}}});
  EXPECT_EQ(farm.leased(worker).at(0).job_id, first.spec->id);
  EXPECT_EQ(farm.scheduler.waiting().wait_text(second), "waits for job j1 to end; it is RUNNING");
  ASSERT_TRUE(farm.scheduler.lifecycle().cancel(first, farm.now).ok());
  EXPECT_EQ(farm.leased(worker).at(0).job_id, second.spec->id);
}

TEST(Dependency, RemovalBeforeSuccessFailsJob) {
  SchedulerHarness farm;
  Job& first = farm.add_job({.tiles = 1});
  Job& second = farm.add_job({.tiles = 1, .after = {{first.spec->id, Kind::success}}});
  const Job& any = farm.add_job({.tiles = 1, .after = {{first.spec->id, Kind::end}}});
  ASSERT_TRUE(farm.scheduler.lifecycle().cancel(first, farm.now).ok());
  farm.scheduler.lifecycle().remove_job(first.key);
  EXPECT_EQ(second.state, JobState::failed);
  EXPECT_EQ(second.failure_code, absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(second.reason,
            "job j1, which had to be done before job j2, was removed; `tessera set j2 --no-after` "
            "drops the dependency, then `tessera retry j2` starts the job");
  EXPECT_FALSE(any.is_blocked);
  EXPECT_TRUE(absl::IsFailedPrecondition(farm.scheduler.lifecycle().retry(second, farm.now)));
  auto spec = std::make_shared<JobSpec>(*second.spec);
  spec->after.clear();
  farm.scheduler.changes().change(second, spec, farm.now);
  EXPECT_TRUE(farm.scheduler.lifecycle().retry(second, farm.now).ok());
  EXPECT_TRUE(second.is_runnable());
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(Dependency, RemovalAfterSuccessReleasesJob) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.credits = 1});
  Job& first = farm.add_job({.tiles = 1});
  Job& second = farm.queue_job({.tiles = 1, .after = {{first.spec->id, Kind::success}}});
  ASSERT_TRUE(farm.scheduler.lifecycle().pause(second, "asked", farm.now).ok());
  render(farm, worker, first);
  farm.scheduler.lifecycle().remove_job(first.key);
  EXPECT_TRUE(farm.scheduler.lifecycle().resume(second, farm.now).ok());
  EXPECT_EQ(farm.leased(worker).size(), 1u);
}

TEST(Dependency, RestartRestoresHowRemovedJobEnded) {
  SchedulerHarness farm;
  const Job& met = farm.add_job({.tiles = 1, .after = {{"gone", Kind::frames}}});
  const Job& impossible = farm.add_job({.tiles = 1, .after = {{"lost", Kind::success}}});
  EXPECT_FALSE(met.is_runnable()) << "nothing is known of the job yet";
  farm.scheduler.lifecycle().note_removed("gone", JobState::done);
  farm.scheduler.lifecycle().note_removed("lost", JobState::failed);
  EXPECT_TRUE(met.is_runnable());
  EXPECT_EQ(impossible.state, JobState::failed);
}

TEST(Dependency, ChangeKeepsHowRemovedJobEnded) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1, .after = {{"gone", Kind::success}}});
  farm.scheduler.lifecycle().note_removed("gone", JobState::done);
  auto spec = std::make_shared<JobSpec>(*job.spec);
  spec->priority = 5;
  farm.scheduler.changes().change(job, spec, farm.now);
  EXPECT_TRUE(job.is_runnable());
}

TEST(Dependency, FrameWaitsForSameFrameOfOther) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 4, .credits = 4});
  Job& first = farm.add_job({.tiles = 2, .frames = 3});
  Job& second =
      farm.add_job({.tiles = 2, .frames = 3, .priority = 50, .after = {{"j1", Kind::frames}}});
  EXPECT_EQ(farm.scheduler.waiting().wait_text(second),
            "waits for job j1 to finish frames; it is RUNNING");
  std::vector<UnitName> order;
  for (auto units = farm.leased(worker); !units.empty(); units = farm.leased(worker)) {
    for (const UnitName& unit : units) {
      order.push_back(unit);
      EXPECT_TRUE(unit.job_id == first.spec->id || first.plan->is_finished(unit.unit.frame));
      farm.complete(worker, unit);
      if (!first.plan->is_complete(unit.unit.frame)) continue;
      farm.scheduler.results().finish_frame(first, unit.unit.frame, farm.now);
      EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
    }
  }
  EXPECT_EQ(order.size(), 12u) << "all units of both jobs";
  EXPECT_EQ(first.state, JobState::done);
  EXPECT_EQ(second.plan->counts().committed, 6);
}

TEST(Dependency, FramesWaitAgainAfterExtension) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.credits = 8});
  Job& first = farm.add_job({.tiles = 1, .frames = 2});
  Job& second = farm.add_job({.tiles = 1, .frames = 2, .after = {{"j1", Kind::frames}}});
  const UnitName unit = farm.leased(worker).at(0);
  farm.commit(worker, unit);
  farm.scheduler.results().finish_frame(first, 0, farm.now);
  ASSERT_EQ(second.blocked_frames.size(), 1u);
  auto spec = std::make_shared<JobSpec>(*first.spec);
  spec->settings.spp = 64;
  farm.scheduler.changes().extend(first, spec);
  EXPECT_EQ(second.blocked_frames.size(), 2u) << "the frame is rendered again";
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST(Dependency, ChainOfJobsRunsInOrder) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  farm.queue_job({.tiles = 1});
  for (int i = 2; i <= 20; ++i) {
    farm.queue_job({.tiles = 1, .priority = i, .after = {{"j" + std::to_string(i - 1)}}});
  }
  farm.scheduler.dispatcher().dispatch_all(farm.now);
  for (int i = 1; i <= 20; ++i) {
    const UnitName unit = farm.leased(worker).at(0);
    ASSERT_EQ(unit.job_id, "j" + std::to_string(i));
    farm.complete(worker, unit);
    farm.scheduler.results().finish_frame(*farm.scheduler.jobs().find(unit.job_id), 0, farm.now);
  }
}

TEST(Dependency, BlockedJobsCostNoLooks) {
  SchedulerHarness farm;
  farm.queue_job({.tiles = 1});
  for (int i = 0; i < 1000; ++i) farm.queue_job({.tiles = 1, .after = {{"j1"}}});
  const std::int64_t before = farm.scheduler.step_count();
  farm.connect("w1", {.threads = 1, .credits = 1});
  EXPECT_LE(farm.scheduler.step_count() - before, 10);
}

}  // namespace
}  // namespace tessera::server
