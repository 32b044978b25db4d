// The state of a coordinator after a restart.

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

using RestartTest = CoordinatorFixture;

TEST_F(RestartTest, RestartContinuesFromCommittedUnits) {
  const std::string whole = create_job("whole", 64);
  auto first = join("w1");
  finish_job(first, whole);

  const std::string job = create_job("cut", 64);
  collect(first);
  std::vector<contract::Unit> acknowledged;
  for (std::size_t i = 0; i < 5; ++i) {
    deliver(first, first.units[2 * i], bytes_of(first.units[2 * i]));
    acknowledged.push_back(first.units[2 * i].name.unit);
  }
  pump();
  start();  // the process was killed
  EXPECT_EQ(view(job).committed_unit_count, 5);
  EXPECT_EQ(view(job).state, JobState::running);
  auto worker = join("w1", 64);
  for (const Leased& unit : worker.units) {
    EXPECT_EQ(std::count(acknowledged.begin(), acknowledged.end(), unit.name.unit), 0)
        << "an acknowledged unit is leased again";
    EXPECT_EQ(unit.lease.attempt.boot, store.boot_count());
  }
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), pixels_of(whole));
  EXPECT_DOUBLE_EQ(view(job).cpu_seconds, 6) << "exact over crashes";
  EXPECT_EQ(coordinator->queries().report(whole)->contributions.at("w1").units, 12);
}

TEST_F(RestartTest, LeasesSurviveRestart) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  start();
  auto again = join("w1", 0);
  for (const Leased& unit : units) EXPECT_TRUE(deliver(again, unit, bytes_of(unit)));
  pump();
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(RestartTest, RestartWritesCompleteFrame) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  write_all();
  start();  // before the film thread has run
  EXPECT_EQ(view(job).state, JobState::running);
  pump();
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(RestartTest, DamagedBlockIsRenderedAgain) {
  const std::string whole = create_job("whole");
  auto worker = join("w1");
  finish_job(worker, whole);
  const std::string job = create_job("a");
  deliver_all(worker);
  write_all();
  store.units().damage({0, 4, 0});
  start();  // merged tiles are lost, blocks are read again
  pump();
  EXPECT_EQ(view(job).state, JobState::running);
  auto again = join("w1");
  ASSERT_EQ(again.units.size(), 1u);
  EXPECT_EQ(again.units[0].name.unit, (contract::Unit{0, 4, 0}));
  finish_job(again, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(view(job).committed_sample_count, view(whole).committed_sample_count);
  EXPECT_EQ(pixels_of(job), pixels_of(whole));
  EXPECT_EQ(coordinator->queries().report(job)->counters.redone, 1);
}

TEST_F(RestartTest, GrantsWaitForKnownWorkersAfterRestart) {
  create_job("a");
  join("w1");
  join("w2");
  pump();  // the known workers are journaled
  start();
  auto worker = join("w1");
  EXPECT_TRUE(worker.units.empty());
  join("w2");
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
}

}  // namespace
}  // namespace tessera::server
