// Answers to changes whose rows cannot be written, as on a full disk.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <string>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class FailedWriteTest : public CoordinatorFixture {
 protected:
  void fill_disk() {
    store.controls().fail_commits_with(absl::ResourceExhaustedError("disk full"));
  }
  void free_disk() { store.controls().fail_commits_with(absl::OkStatus()); }
  absl::StatusOr<JobView> extend(const std::string& job_id, std::int32_t spp) {
    absl::StatusOr<JobView> result = absl::UnknownError("no answer");
    coordinator->jobs().extend_job(job_id, {spp, {}}, [&](const auto& view) { result = view; });
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
  EXPECT_EQ(coordinator->queries().list_jobs(0, 10).jobs.size(), 1u);
  free_disk();
  EXPECT_TRUE(remove(job).ok());
  EXPECT_TRUE(coordinator->queries().list_jobs(0, 10).jobs.empty());
}

TEST_F(FailedWriteTest, FaultOfOneJobLeavesOtherJobs) {
  const std::string faulty = create_job("a"), other = create_job("b");
  auto worker = join("w1");
  store.controls().fail_commits_of(faulty, absl::InternalError("cannot open its segment"));
  deliver_all(worker);
  pump();
  EXPECT_EQ(view(faulty).committed_unit_count, 0);
  EXPECT_EQ(view(other).state, JobState::done);
}

TEST_F(FailedWriteTest, FailedTransactionAcknowledgesNothing) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  deliver_all(worker);
  store.controls().fail_transactions_with(absl::ResourceExhaustedError("disk full"));
  pump();
  collect(worker);
  EXPECT_TRUE(worker.acknowledgements.empty());
  EXPECT_EQ(view(job).state, JobState::paused);
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec_of("b")).status()));
  EXPECT_EQ(coordinator->queries().list_jobs(0, 10).jobs.size(), 1u);
  store.controls().fail_transactions_with(absl::OkStatus());
  for (const Leased& unit : units) deliver(worker, unit, bytes_of(unit));
  pump();
  EXPECT_EQ(view(job).state, JobState::done) << "blocks sent again are committed";
}

TEST_F(FailedWriteTest, RoundWritesOneTransaction) {
  const std::string job = create_job("a");
  for (int i = 0; i < 20; ++i) join("w" + std::to_string(i));
  const int before = store.controls().transaction_count();
  write_round();
  EXPECT_EQ(store.controls().transaction_count(), before + 1) << "20 workers and a job";
  int created = 0;
  for (int i = 0; i < 20; ++i) {
    coordinator->admission().create_job(spec_of("job" + std::to_string(i)),
                                        [&](const auto& view) { created += view.ok() ? 1 : 0; });
  }
  write_round();
  EXPECT_EQ(created, 20);
  EXPECT_EQ(store.controls().transaction_count(), before + 2);
}

TEST_F(FailedWriteTest, RowsOfRunningJobsShareTransaction) {
  constexpr int kJobs = 30;
  for (int i = 0; i < kJobs; ++i) create_job("job" + std::to_string(i));
  join("w1", 6 * kJobs);
  pump();
  int running = 0;
  for (const JobRecord& job : *store.jobs().list())
    running += job.state == static_cast<std::int32_t>(JobState::running) ? 1 : 0;
  ASSERT_EQ(running, kJobs);
  const int before = store.controls().transaction_count();
  now += std::chrono::seconds(21);
  coordinator->tick();
  pump();
  for (const JobRecord& job : *store.jobs().list()) EXPECT_GE(job.wall_seconds, 21) << job.name;
  EXPECT_LE(store.controls().transaction_count(), before + 2);
}

TEST_F(FailedWriteTest, QuotaCountsJobsOfSameTransaction) {
  options.client_quotas.defaults.jobs = 2;
  start();
  int created = 0, repeated = 0;
  for (int i = 0; i < 4; ++i) {
    coordinator->admission().create_job(spec_of("job" + std::to_string(i)),
                                        [&](const auto& view) { created += view.ok() ? 1 : 0; });
    coordinator->admission().create_job(spec_of("job" + std::to_string(i)),
                                        [&](const auto& view) { repeated += view.ok() ? 1 : 0; });
  }
  write_round();
  EXPECT_EQ(created, 2);
  EXPECT_EQ(repeated, 2) << "the same request is the same job";
  EXPECT_EQ(coordinator->queries().list_jobs(0, 10).jobs.size(), 2u);
}

TEST_F(FailedWriteTest, JobResumesWhenDiskHasRoom) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  fill_disk();
  store.controls().set_free_bytes(0);
  pump();
  ASSERT_EQ(view(job).state, JobState::paused);
  const auto later = [&] {
    now += std::chrono::seconds(10);
    coordinator->tick();
    pump();
  };
  later();
  EXPECT_EQ(view(job).state, JobState::paused);
  free_disk();
  store.controls().set_free_bytes(std::int64_t{1} << 40);
  later();
  EXPECT_EQ(view(job).state, JobState::running);
  ASSERT_TRUE(change(job, JobAdmin::Change::pause).ok());
  later();
  EXPECT_EQ(view(job).state, JobState::paused) << "paused by the user";
}

TEST_F(FailedWriteTest, FullDiskRefusesJobsThatMayFillIt) {
  const std::int64_t need = max_job_size(spec_of("a")).store_bytes;
  ASSERT_LT(need, kRoomForJobs);
  store.controls().set_free_bytes(need - 1);
  const absl::Status refused = create(spec_of("a")).status();
  EXPECT_TRUE(absl::IsResourceExhausted(refused));
  for (const char* part : {"disk of /srv/store", "MB free", "`tessera remove`"}) {
    EXPECT_NE(refused.message().find(part), std::string::npos) << refused;
  }
  store.controls().set_free_bytes(need);
  EXPECT_TRUE(create(spec_of("small")).ok());
  JobSpec large = spec_of("large");
  large.settings.width = large.settings.height = 4096;
  ASSERT_GT(max_job_size(large).store_bytes, kRoomForJobs);
  store.controls().set_free_bytes(kRoomForJobs);
  EXPECT_TRUE(create(large).ok()) << "it may need less";
}

TEST_F(FailedWriteTest, FullDiskIsNotReadyButAlive) {
  Health& health = coordinator->health();
  health.set_accepting(true);
  const auto check = [&] {
    now += std::chrono::seconds(11);
    coordinator->tick();
    pump();
    EXPECT_EQ(health.why_dead(), "");
    return health.why_unready();
  };
  EXPECT_EQ(check(), "");
  store.controls().set_free_bytes(Health::kMinFreeBytes - 1);
  EXPECT_EQ(check(), "the disk of the store is full: 15 MiB are free");
  store.controls().set_free_bytes(Health::kMinFreeBytes);
  EXPECT_EQ(check(), "");

  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  fill_disk();  // for example without free inodes
  pump();
  EXPECT_EQ(check(), "jobs are paused because the disk of the store is full");
  EXPECT_NE(view(job).reason.find("the job resumes when 256 MiB are free"), std::string::npos);
  free_disk();
  store.controls().set_free_bytes(kRoomForJobs);
  check();  // resumes the job
  EXPECT_EQ(check(), "");
}

TEST_F(FailedWriteTest, PauseByUserOutlastsFullDisk) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto fill_and_free = [&](const std::function<void()>& meanwhile) {
    fill_disk();
    pump();
    meanwhile();
    free_disk();
    now += std::chrono::seconds(10);
    coordinator->tick();
    pump();
  };
  store.controls().set_free_bytes(std::int64_t{1} << 40);
  deliver_all(worker);
  fill_and_free([&] {
    ASSERT_EQ(view(job).state, JobState::paused) << "for want of room";
    EXPECT_FALSE(change(job, JobAdmin::Change::pause).ok()) << "not recorded, but in effect";
  });
  EXPECT_EQ(view(job).state, JobState::paused) << "paused by the user when the disk was full";
  EXPECT_EQ(view(job).reason, "paused by the user");
}

TEST_F(FailedWriteTest, FullDiskDoesNotTakeOverPauseOfUser) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  coordinator->jobs().change_job(job, JobAdmin::Change::pause, [](const auto&) {});
  fill_disk();
  pump();
  EXPECT_EQ(view(job).reason, "paused by the user") << "its blocks cannot be committed";
  free_disk();
  store.controls().set_free_bytes(std::int64_t{1} << 40);
  now += std::chrono::seconds(10);
  coordinator->tick();
  pump();
  EXPECT_EQ(view(job).state, JobState::paused);
}

TEST_F(FailedWriteTest, AssetsAreCollectedOnlyOverTheirQuota) {
  options.asset_quota_bytes = 1000;
  start();
  store.controls().set_used_bytes(1 << 20);
  const auto publish = [&](const std::string& text) {
    const std::string path = coordinator->assets().new_upload_path().value();
    std::ofstream(path) << text;
    coordinator->assets().publish_asset(path, contract::sha256(text), [](const auto& status) {
      EXPECT_TRUE(status.ok()) << status;
    });
    pump();
  };
  const auto add = [&](const std::string& text) {
    coordinator->assets().add_asset(contract::sha256(text), text,
                                    [](const auto& status) { EXPECT_TRUE(status.ok()) << status; });
    pump();
  };
  store.assets().set_used_bytes(1000);
  publish("a");
  add("b");
  EXPECT_EQ(store.assets().collection_count(), 0) << "blocks fill the store, not assets";
  store.assets().set_used_bytes(1001);
  publish("c");
  EXPECT_EQ(store.assets().collection_count(), 1);
  add("d");
  EXPECT_EQ(store.assets().collection_count(), 2);
}

}  // namespace
}  // namespace tessera::server
