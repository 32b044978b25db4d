// Automatic removal of jobs that ended long ago.

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kDayUs = std::int64_t{86'400} * 1'000'000;

class RetentionTest : public CoordinatorFixture {
 protected:
  void keep_for(std::int64_t span_us) {
    options.job_retention_us = span_us;
    start();
  }
  /// Advances both clocks and runs the coordinator's timer.
  void pass(std::int64_t span_us) {
    wall_us += span_us;
    now += std::chrono::microseconds(span_us) + std::chrono::seconds(10);
    coordinator->tick();
    pump();
  }
  bool exists(const std::string& job) { return coordinator->queries().job(job).ok(); }
};

TEST_F(RetentionTest, EndedJobIsRemovedAfterRetention) {
  keep_for(2 * kDayUs);
  auto worker = join("w1");
  const std::string done = create_job("done");
  finish_job(worker, done);
  const std::string cancelled = create_job("cancelled");
  ASSERT_TRUE(change(cancelled, JobAdmin::Change::cancel).ok());
  const std::string paused = create_job("paused");
  ASSERT_TRUE(change(paused, JobAdmin::Change::pause).ok());
  pass(kDayUs);
  const std::string later = create_job("later");
  ASSERT_TRUE(change(later, JobAdmin::Change::cancel).ok());
  EXPECT_TRUE(exists(done) && exists(cancelled));
  pass(kDayUs);
  EXPECT_FALSE(exists(done));
  EXPECT_FALSE(exists(cancelled));
  EXPECT_TRUE(exists(paused) && exists(later));
  EXPECT_EQ(store.jobs().list()->size(), 2u);
}

TEST_F(RetentionTest, EndTimeSurvivesRestart) {
  keep_for(0);
  const std::string job = create_job("a");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  pass(100 * kDayUs);
  EXPECT_TRUE(exists(job)) << "by default jobs stay";
  keep_for(kDayUs);
  pass(0);
  EXPECT_FALSE(exists(job));
}

TEST_F(RetentionTest, JumpOfWallClockRemovesNoJob) {
  keep_for(kDayUs);
  const std::string job = create_job("a");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  wall_us += 1000 * kDayUs;
  pass(kDayUs / 2);
  EXPECT_TRUE(exists(job));
  pass(kDayUs / 2);
  EXPECT_FALSE(exists(job));
}

TEST_F(RetentionTest, JumpOfWallClockOverRestartRemovesNoJob) {
  keep_for(kDayUs);
  const std::string job = create_job("a");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  pass(kDayUs / 2);
  wall_us += 1000 * kDayUs;
  start();
  pass(kDayUs / 4);
  EXPECT_TRUE(exists(job));
  pass(kDayUs / 4);
  EXPECT_FALSE(exists(job)) << "the time before the restart counts";
}

TEST_F(RetentionTest, RetriedJobIsKept) {
  keep_for(kDayUs);
  const std::string job = create_job("a");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  ASSERT_TRUE(change(job, JobAdmin::Change::retry).ok());
  pass(10 * kDayUs);
  ASSERT_TRUE(exists(job));
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  pass(kDayUs / 2);
  EXPECT_TRUE(exists(job)) << "counted from its last end";
  pass(kDayUs / 2);
  EXPECT_FALSE(exists(job));
}

TEST_F(RetentionTest, JobsAreRemovedInGroups) {
  keep_for(kDayUs);
  for (int i = 0; i < 160; ++i) {
    const std::string job = create_job("j" + std::to_string(i));
    ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  }
  now += std::chrono::microseconds(kDayUs) + std::chrono::seconds(10);
  coordinator->tick();
  const int before = store.controls().transaction_count();
  std::vector<std::size_t> sizes;
  while (write_round()) sizes.push_back(store.jobs().list()->size());
  EXPECT_EQ(sizes, (std::vector<std::size_t>{96, 32, 0})) << "other rounds come between them";
  EXPECT_LE(store.controls().transaction_count() - before, 6) << "one transaction for each group";
}

TEST_F(RetentionTest, RemovalDoesNotLockFarmInTransaction) {
  const std::string job = create_job("a");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  bool is_free = false;  // the transaction ends while another thread holds the farm's lock
  store.controls().wrap_transactions([&](const std::function<void()>& body) {
    std::promise<void> locked, written;
    std::thread other([&] {
      const FarmView view(coordinator->farm());
      locked.set_value();
      is_free = written.get_future().wait_for(std::chrono::seconds(2)) == std::future_status::ready;
    });
    locked.get_future().wait();
    body();
    written.set_value();
    other.join();
  });
  EXPECT_TRUE(remove(job).ok());
  store.controls().wrap_transactions({});
  EXPECT_FALSE(exists(job));
  EXPECT_TRUE(is_free);
}

TEST_F(RetentionTest, DoneJobKeepsFiguresWithoutUnits) {
  const std::string job = create_job("a", 64);
  auto worker = join("w1");
  finish_job(worker, job);
  const JobReport before = coordinator->queries().report(job).value();
  ASSERT_TRUE(store.units().for_each(job, [](const UnitRecord&) { FAIL(); }).ok());
  start();
  const JobReport after = coordinator->queries().report(job).value();
  EXPECT_EQ(after.view.committed_unit_count, before.view.committed_unit_count);
  EXPECT_EQ(after.view.committed_sample_count, before.view.committed_sample_count);
  EXPECT_DOUBLE_EQ(after.view.cpu_seconds, before.view.cpu_seconds);
  EXPECT_EQ(after.counters.audited, before.counters.audited);
  ASSERT_EQ(after.contributions.size(), 1u);
  EXPECT_EQ(after.contributions.at("w1").units, before.contributions.at("w1").units);
}

}  // namespace
}  // namespace tessera::server
