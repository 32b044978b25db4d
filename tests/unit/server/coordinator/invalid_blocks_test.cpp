// A worker whose blocks are invalid: its jobs continue on other workers, and it is quarantined.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class InvalidBlocks : public CoordinatorFixture {
 protected:
  InvalidBlocks() { options.policy.audit_fraction = 0; }

  /// Delivers a block whose bytes do not match its digest.
  void deliver_junk(const TestWorker& worker, const Leased& unit) {
    std::string bytes = bytes_of(unit);
    const BlockHeader header = header_of(unit, bytes);
    bytes.back() = static_cast<char>(bytes.back() ^ 1);
    const auto admission = coordinator->intake().admit(worker.id, header);
    if (admission) coordinator->intake().deliver(worker.id, header, *admission, bytes);
    pump();
  }
  static std::ptrdiff_t rejected(const TestWorker& worker) {
    return std::count_if(worker.acknowledgements.begin(), worker.acknowledgements.end(),
                         [](const auto& answer) { return answer.status == AckStatus::rejected; });
  }
  bool is_quarantined(const std::string& id) {
    for (const auto& [worker, silence] : coordinator->workers().list()) {
      if (worker.id == id) return worker.quarantined;
    }
    return false;
  }
  /// Pixels of a job of the same settings that a worker without faults renders alone.
  std::string correct_pixels() {
    const std::string job = create_job("calm");
    TestWorker worker = join("calm");
    finish_job(worker, job);
    coordinator->workers().begin_draining(worker.session);
    coordinator->workers().disconnect(worker.session);
    return pixels_of(job);
  }
};

TEST_F(InvalidBlocks, ThreeOfOneUnitDoNotStopJob) {
  const std::string pixels = correct_pixels();
  TestWorker faulty = join("faulty", 1);
  TestWorker good = join("good", 0);
  const std::string job = create_job("a");
  collect(faulty);
  ASSERT_EQ(faulty.units.size(), 1u);
  const Leased unit = faulty.units[0];
  for (int i = 0; i < 3; ++i) deliver_junk(faulty, unit);
  collect(faulty);
  EXPECT_EQ(rejected(faulty), 3);
  EXPECT_EQ(view(job).state, JobState::running);

  faulty.units.clear();
  for (int round = 0; round < 10; ++round) {
    coordinator->workers().grant_credits(faulty.session, 1);
    collect(faulty);
    for (const Leased& other : faulty.units) EXPECT_FALSE(other.name == unit.name);
    deliver_all(faulty);
    pump();
  }
  EXPECT_EQ(view(job).committed_unit_count, 5) << "the unit waits for another worker";
  EXPECT_EQ(view(job).state, JobState::running);
  coordinator->workers().grant_credits(good.session, 64);
  finish_job(good, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), pixels);
}

TEST_F(InvalidBlocks, WorkerIsQuarantinedAfterThreeUnits) {
  const std::string pixels = correct_pixels();
  TestWorker faulty = join("faulty", 3);
  TestWorker good = join("good", 0);
  const std::string job = create_job("a");
  collect(faulty);
  const std::vector<Leased> units = std::exchange(faulty.units, {});
  ASSERT_EQ(units.size(), 3u);
  for (const Leased& unit : units) deliver_junk(faulty, unit);
  EXPECT_FALSE(is_quarantined("faulty")) << "the units or the scene may be at fault";
  coordinator->workers().grant_credits(good.session, 64);
  finish_job(good, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), pixels);
  EXPECT_TRUE(is_quarantined("faulty"));
  EXPECT_FALSE(is_quarantined("good"));
  coordinator->workers().grant_credits(faulty.session, 64);
  create_job("b");
  collect(faulty);
  EXPECT_TRUE(faulty.units.empty());
}

TEST_F(InvalidBlocks, TwoWorkersPauseJob) {
  std::vector<TestWorker> faulty = {join("faulty1", 1), join("faulty2", 1)};
  const std::string job = create_job("a");
  for (int round = 0; round < 50 && view(job).state != JobState::paused; ++round) {
    for (TestWorker& worker : faulty) {
      collect(worker);
      for (const Leased& unit : std::exchange(worker.units, {})) deliver_junk(worker, unit);
      coordinator->workers().grant_credits(worker.session, 1);
    }
  }
  EXPECT_EQ(view(job).state, JobState::paused) << "somebody must look at it";
  EXPECT_NE(view(job).reason.find("worker faulty1: block rejected"), std::string::npos)
      << view(job).reason;
  EXPECT_NE(view(job).reason.find("worker faulty2: block rejected"), std::string::npos)
      << view(job).reason;
}

}  // namespace
}  // namespace tessera::server
