// Jobs that failures pause, and what users are told about it.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

/// A job of which three workers fail one tile, so that it is paused, and a slow worker holds
/// another unit.
class FailurePause : public testing::Test {
 protected:
  FailurePause() {
    slow = farm.connect("slow", {.threads = 1, .credits = 1});
    held = farm.leased(slow);
    for (const char* id : {"w1", "w2", "w3"}) {
      keys_.push_back(farm.connect(id, {.threads = 1, .credits = 1}));
    }
    for (int round = 0; round < 9 && job.state == JobState::running; ++round) {
      for (const WorkerKey key : keys_) {
        for (const UnitName& unit : farm.leased(key)) {
          if (unit.unit.tile == poisoned) {
            farm.fail(key, unit);
          } else {
            farm.complete(key, unit);
          }
        }
      }
    }
  }

  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 12});
  std::int32_t poisoned = 7;
  WorkerKey slow = 0;
  std::vector<UnitName> held;

 private:
  std::vector<WorkerKey> keys_;
};

TEST_F(FailurePause, ListsWorkersUnitsAndMessages) {
  ASSERT_TRUE(job.is_paused_by_failures());
  EXPECT_EQ(job.failure_code, absl::StatusCode::kInternal);
  ASSERT_EQ(job.failed_attempts.size(), 3u);
  std::set<std::string> workers;
  for (const FailedAttempt& attempt : job.failed_attempts) {
    EXPECT_EQ(attempt.unit.tile, poisoned);
    EXPECT_EQ(attempt.message, "broke");
    workers.insert(attempt.worker_id);
  }
  EXPECT_EQ(workers, (std::set<std::string>{"w1", "w2", "w3"}));
  EXPECT_TRUE(farm.scheduler.verify().ok()) << farm.scheduler.verify();
}

TEST_F(FailurePause, PauseByUserKeepsReason) {
  const std::string reason = job.reason;
  ASSERT_TRUE(farm.scheduler.lifecycle().pause(job, "paused by the user", farm.now).ok());
  EXPECT_EQ(job.reason, reason);
  EXPECT_TRUE(job.is_paused_by_failures());
}

TEST_F(FailurePause, UnitsInFlightStillCommit) {
  ASSERT_EQ(held.size(), 1u);
  ASSERT_EQ(job.plan->counts().in_flight, 1) << "only that of the slow worker";
  farm.complete(slow, held[0]);
  EXPECT_TRUE(job.plan->is_committed(held[0].unit));
  EXPECT_TRUE(job.is_paused_by_failures());
  farm.pass(1s, {slow});
  EXPECT_TRUE(farm.leased(slow).empty());
}

TEST_F(FailurePause, LaterFailureIsListedOnce) {
  farm.scheduler.take_effects();
  farm.fail(slow, held.at(0));
  ASSERT_EQ(job.failed_attempts.size(), 4u);
  EXPECT_EQ(job.failed_attempts.back(), (FailedAttempt{held[0].unit, "slow", "broke"}));
  const Effects effects = farm.scheduler.take_effects();
  EXPECT_TRUE(effects.changed.empty()) << "its state is the same: no event";
  EXPECT_EQ(effects.revised, std::vector<JobKey>{job.key});
}

TEST_F(FailurePause, RetryAndResumeStartAgainWithoutFailures) {
  for (const bool with_resume : {false, true}) {
    if (with_resume) {
      ASSERT_TRUE(farm.scheduler.lifecycle().pause(job, "asked", farm.now).ok());
      job.failure_code = absl::StatusCode::kInternal;  // as if failures had paused it
      ASSERT_TRUE(farm.scheduler.lifecycle().resume(job, farm.now).ok());
    } else {
      ASSERT_TRUE(farm.scheduler.lifecycle().retry(job, farm.now).ok());
    }
    EXPECT_EQ(job.state, JobState::running);
    EXPECT_EQ(job.failure_code, absl::StatusCode::kOk);
    EXPECT_TRUE(job.failed_attempts.empty());
    EXPECT_TRUE(job.unit_failures.empty());
    EXPECT_EQ(job.reason, "");
  }
}

TEST_F(FailurePause, CancelForgetsFailures) {
  ASSERT_TRUE(farm.scheduler.lifecycle().cancel(job, farm.now).ok());
  EXPECT_EQ(job.failure_code, absl::StatusCode::kOk);
  EXPECT_TRUE(job.failed_attempts.empty());
}

TEST(FailurePauseOfLosses, ListsWorkersThatWereLost) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 1});
  for (int loss = 1; loss <= 11; ++loss) {
    farm.leased(farm.connect("w" + std::to_string(loss)));
    farm.pass(5200ms, {});
  }
  ASSERT_TRUE(job.is_paused_by_failures());
  EXPECT_EQ(job.failure_code, absl::StatusCode::kUnavailable);
  ASSERT_EQ(job.failed_attempts.size(), 11u);
  EXPECT_EQ(job.failed_attempts[0].message, "lost with its worker, 1 time");
}

TEST(FailurePauseOfScene, BadSceneStillFailsJobAndListsWorker) {
  SchedulerHarness farm;
  Job& job = farm.add_job({.tiles = 8});
  const WorkerKey worker = farm.connect("w1");
  farm.fail(worker, farm.leased(worker).at(0), absl::StatusCode::kNotFound);
  EXPECT_EQ(job.state, JobState::failed);
  ASSERT_EQ(job.failed_attempts.size(), 1u);
  EXPECT_EQ(job.failed_attempts[0].worker_id, "w1");
}

}  // namespace
}  // namespace tessera::server
