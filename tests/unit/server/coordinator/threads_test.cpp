#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

/// For the tsan preset: workers, clients, writer, answers, film threads and timer run at
/// once, without gRPC.
class CoordinatorThreads : public CoordinatorFixture {
 protected:
  /// Runs a worker that delivers all its leased units until the job is done.
  void work(const std::string& id, const std::string& job, int duplicates) {
    TestWorker worker = join(id, 3);
    while (!has_ended(view(job).state)) {
      const std::size_t before = worker.acknowledgements.size();
      collect(worker);
      for (const Leased& unit : std::exchange(worker.units, {})) {
        coordinator->workers().heartbeat(worker.session, {unit.name}, 1000);
        for (int i = 0; i <= duplicates; ++i) deliver(worker, unit, bytes_of(unit));
      }
      std::this_thread::yield();
      collect(worker);
      coordinator->workers().grant_credits(
          worker.session, static_cast<std::int32_t>(worker.acknowledgements.size() - before));
    }
    coordinator->workers().disconnect(worker.session);
  }
};

TEST_F(CoordinatorThreads, ConcurrentUseCommitsEveryUnitOnce) {
  options.film_threads = 4;
  start();
  JobSpec spec = spec_of("hammered", 64);
  spec.settings.width = spec.settings.height = 80;  // 100 tiles, 2 passes
  spec.settings.frames = {{0, 3, 1}};
  const std::string job = create(spec)->view.spec->id;
  std::thread writer([&] {
    while (!coordinator->is_stopping()) coordinator->run_writer(true);
  });
  std::thread answers([&] {
    while (!coordinator->is_stopping()) coordinator->run_answers(true);
  });
  std::vector<std::thread> film;
  for (int i = 0; i < options.film_threads; ++i) {
    film.emplace_back([&] {
      while (!coordinator->is_stopping()) coordinator->run_film(true);
    });
  }
  std::atomic<bool> is_over = false;
  std::thread timer([&] {
    while (!is_over) {
      coordinator->tick();
      coordinator->workers().list();
      coordinator->queries().list_jobs(0, 10);
      coordinator->queries().report(job).status().IgnoreError();
      std::this_thread::yield();
    }
  });
  std::vector<std::thread> workers;
  for (int i = 0; i < 4; ++i) {
    workers.emplace_back([this, &job, i] { work("w" + std::to_string(i), job, i % 2); });
  }
  for (std::thread& worker : workers) worker.join();
  is_over = true;
  timer.join();
  coordinator->stop();
  writer.join();
  answers.join();
  for (std::thread& thread : film) thread.join();
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(view(job).finished_frame_count, 4);
  const auto report = coordinator->queries().report(job);
  std::int64_t units = 0;
  for (const auto& [id, contribution] : report->contributions) units += contribution.units;
  EXPECT_EQ(units, 800);
  EXPECT_EQ(report->counters.mismatched, 0);
}

}  // namespace
}  // namespace tessera::server
