// A hundred thousand jobs that wait do not slow down what happens regularly.

#include <gtest/gtest.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <ctime>
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

/// CPU time that a thread has used, in seconds.
double cpu_seconds(pthread_t thread) {
  clockid_t clock{};
  timespec time{};
  if (pthread_getcpuclockid(thread, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Other threads get the lock of the farm meanwhile. The wait for it counts in CPU time of the
/// reader, which other work of the machine does not change; several attempts, because the thread
/// that waits may not run when the lock is free.
TEST_F(ManyJobs, MetricsLockTheFarmBriefly) {
  queue(100'000);
  bool was_brief = false;
  for (int attempt = 0; attempt < 50 && !was_brief; ++attempt) {
    std::atomic<bool> has_metrics = false, may_end = false;
    std::thread reader([&] {
      coordinator->queries().metrics();
      has_metrics = true;
      while (!may_end) std::this_thread::yield();  // its clock is read until then
    });
    const double start = cpu_seconds(reader.native_handle());
    double longest = 0, last = start;
    while (!has_metrics) {
      const double before = cpu_seconds(reader.native_handle());
      const FarmView view(coordinator->farm());
      last = cpu_seconds(reader.native_handle());
      longest = std::max(longest, last - before);
    }
    may_end = true;
    reader.join();
    was_brief = longest < (last - start) / 2;
  }
  EXPECT_TRUE(was_brief);
}

}  // namespace
}  // namespace tessera::server
