// A hundred thousand jobs that wait do not slow down what happens regularly.

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "contract/version.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

class ManyJobs : public CoordinatorFixture {
 protected:
  /// Restarts the server with this many queued jobs.
  void queue(int count) {
    const JobSpec spec = remember(spec_of("job"));
    for (int i = 0; i < count; ++i) {
      JobRecord record;
      record.id = "job-" + std::to_string(i);
      record.request = spec.request;
      record.state = static_cast<std::int32_t>(JobState::queued);
      record.render_contract = contract::kRenderContract;
      ASSERT_TRUE(store.jobs().add(record).ok());
    }
    start();
  }
};

/// Four thousand ticks take less than a second, and at least 24 s if they visit the jobs.
TEST_F(ManyJobs, TicksDoNotVisitThem) {
  options.job_retention_us = 1'000'000;
  queue(100'000);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 4000; ++i) {
    now += 30s;
    coordinator->tick();
    coordinator->run_writer(false);
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, 10s);
}

/// Several attempts, because the machine may have other work.
TEST_F(ManyJobs, MetricsLockTheFarmBriefly) {
  using Clock = std::chrono::steady_clock;
  queue(100'000);
  bool was_brief = false;
  for (int attempt = 0; attempt < 30 && !was_brief; ++attempt) {
    std::atomic<bool> is_done = false;
    Clock::duration whole{};
    std::thread reader([&] {
      const auto start = Clock::now();
      coordinator->queries().metrics();
      whole = Clock::now() - start;
      is_done = true;
    });
    Clock::duration longest{};
    while (!is_done) {
      const auto start = Clock::now();
      { const FarmView view(coordinator->farm()); }
      longest = std::max(longest, Clock::now() - start);
      std::this_thread::yield();
    }
    reader.join();
    was_brief = longest < whole / 4;
  }
  EXPECT_TRUE(was_brief);
}

}  // namespace
}  // namespace tessera::server
