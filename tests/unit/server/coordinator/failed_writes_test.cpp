// Answers to changes whose rows cannot be written, as on a full disk.
#include <gtest/gtest.h>

#include <string>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class FailedWriteTest : public CoordinatorFixture {
 protected:
  void fill_disk() { store.fail_commits_with(absl::ResourceExhaustedError("disk full")); }
  void free_disk() { store.fail_commits_with(absl::OkStatus()); }
  absl::StatusOr<JobView> extend(const std::string& job_id, std::int32_t spp) {
    absl::StatusOr<JobView> result = absl::UnknownError("no answer");
    coordinator->jobs().extend_job(job_id, {spp, {}}, [&](const auto& view) { result = view; });
    pump();
    return result;
  }
  absl::Status remove(const std::string& job_id) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->jobs().remove_job(job_id, [&](const absl::Status& status) { result = status; });
    pump();
    return result;
  }
};

TEST_F(FailedWriteTest, CancelIsAnsweredWithFailureOfItsRow) {
  const std::string job = create_job("a");
  fill_disk();
  const auto cancelled = change(job, JobAdmin::Change::cancel);
  EXPECT_TRUE(absl::IsResourceExhausted(cancelled.status())) << cancelled.status();
  EXPECT_EQ(view(job).state, JobState::cancelled) << "in effect until a restart";
  start();
  EXPECT_EQ(view(job).state, JobState::queued);
  free_disk();
  EXPECT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  start();
  EXPECT_EQ(view(job).state, JobState::cancelled) << "acknowledged is durable";
}

TEST_F(FailedWriteTest, UnwrittenRowIsWrittenLater) {
  const std::string job = create_job("a");
  fill_disk();
  EXPECT_FALSE(change(job, JobAdmin::Change::cancel).ok());
  free_disk();
  now += std::chrono::seconds(30);
  coordinator->tick();
  pump();
  start();
  EXPECT_EQ(view(job).state, JobState::cancelled);
}

TEST_F(FailedWriteTest, FailedExtensionChangesNothing) {
  const std::string job = create_job("short", 32);
  auto worker = join("w1", 8);
  deliver_all(worker);
  pump();
  const JobView before = view(job);
  ASSERT_GT(before.committed_unit_count, 6) << "units of both passes";
  fill_disk();
  EXPECT_TRUE(absl::IsResourceExhausted(extend(job, 64).status()));
  for (int restart = 0; restart < 2; ++restart) {
    EXPECT_EQ(view(job).spec->settings.spp, 32);
    EXPECT_EQ(view(job).committed_unit_count, before.committed_unit_count);
    start();
  }
  free_disk();
  ASSERT_TRUE(extend(job, 64).ok());
  start();
  EXPECT_EQ(view(job).spec->settings.spp, 64);
  EXPECT_EQ(view(job).committed_unit_count, 6) << "pass 0 is the same in both";
}

TEST_F(FailedWriteTest, FailedRemovalKeepsJob) {
  const std::string job = create_job("a");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  fill_disk();
  EXPECT_TRUE(absl::IsResourceExhausted(remove(job)));
  EXPECT_EQ(coordinator->queries().list_jobs(0, 10).size(), 1u);
  free_disk();
  EXPECT_TRUE(remove(job).ok());
  EXPECT_TRUE(coordinator->queries().list_jobs(0, 10).empty());
}

}  // namespace
}  // namespace tessera::server
