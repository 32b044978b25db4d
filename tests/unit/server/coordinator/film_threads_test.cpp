#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

/// Jobs whose frames are merged and written by several film threads. Writing the images of one job
/// can be held up.
class FilmThreads : public CoordinatorFixture {
 protected:
  void SetUp() override {
    options.film_threads = 4;
    start();
    store.frames().on_output_folder([this](const std::string& job_id) {
      if (job_id != held_job_) return;
      ++held_count_;
      EXPECT_EQ(released_.wait_for(kLong), std::future_status::ready);
    });
  }
  void TearDown() override {
    stop_film();
    CoordinatorFixture::TearDown();
  }
  void start_film() {
    for (int i = 0; i < options.film_threads; ++i) {
      threads_.emplace_back([this] {
        while (!coordinator->is_stopping()) coordinator->run_film(true);
      });
    }
  }
  void stop_film() {
    release();
    coordinator->stop();
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  /// From now on a thread that writes an image of the job waits for release().
  void hold(const std::string& job_id) { held_job_ = job_id; }
  void release() {
    if (!std::exchange(is_released_, true)) release_.set_value();
  }
  /// Number of threads that have begun to write an image of the held job.
  int held_count() const { return held_count_; }

  /// Renders as this worker, and writes, until the condition holds. Returns whether it does.
  bool work_until(TestWorker& worker, const std::function<bool()>& condition) {
    const auto deadline = std::chrono::steady_clock::now() + kLong;
    while (!condition()) {
      if (std::chrono::steady_clock::now() > deadline) return false;
      const std::size_t before = worker.acknowledgements.size();
      deliver_all(worker);
      write_all();
      collect(worker);
      coordinator->workers().grant_credits(
          worker.session, static_cast<std::int32_t>(worker.acknowledgements.size() - before));
      std::this_thread::yield();
    }
    return true;
  }
  bool is_done(const std::string& job_id) { return view(job_id).state == JobState::done; }
  std::map<std::int32_t, std::string> digests_of(const std::string& job_id) {
    std::map<std::int32_t, std::string> digests;
    const auto frames = store.frames().list(job_id);
    for (const FrameRecord& frame : *frames) digests[frame.frame] = frame.pixels_sha256.hex();
    return digests;
  }

 private:
  static constexpr std::chrono::minutes kLong{2};

  std::string held_job_;
  std::atomic<int> held_count_ = 0;
  bool is_released_ = false;
  std::promise<void> release_;
  std::shared_future<void> released_{release_.get_future()};
  std::vector<std::thread> threads_;
};

TEST_F(FilmThreads, FrameIsFinishedWhileAnotherIsWritten) {
  const std::string held = create_job("held");
  hold(held);
  start_film();
  TestWorker worker = join("w");
  EXPECT_TRUE(work_until(worker, [&] { return held_count() == 1; }));
  const std::string other = create_job("other");
  EXPECT_TRUE(work_until(worker, [&] { return is_done(other); }));
  EXPECT_FALSE(is_done(held));
  release();
  EXPECT_TRUE(work_until(worker, [&] { return is_done(held); }));
}

TEST_F(FilmThreads, LargeImagesAreWrittenWithinTheirMemory) {
  options.image_memory_bytes = 1;  // one large image at a time
  start();
  JobSpec spec = spec_of("large", 4);
  spec.settings.width = spec.settings.height = 264;  // 1.06 MiB without compression
  spec.settings.tile = 64;
  spec.settings.frames = {{0, 2, 1}};
  const std::string large = create(spec)->view.spec->id, small = create_job("small");
  hold(large);
  start_film();
  TestWorker worker = join("w");
  EXPECT_TRUE(work_until(worker, [&] {
    return view(large).committed_unit_count == view(large).unit_count && held_count() > 0;
  }));
  EXPECT_TRUE(work_until(worker, [&] { return is_done(small); }));
  EXPECT_EQ(held_count(), 1) << "threads are free, but no memory";
  release();
  EXPECT_TRUE(work_until(worker, [&] { return is_done(large); }));
  EXPECT_EQ(held_count(), 3);
}

TEST_F(FilmThreads, SamePixelsWithOneAndFourThreads) {
  noise = 0.1;
  JobSpec spec = spec_of("one", 512);
  spec.settings.error = 0.1;
  spec.settings.frames = {{0, 7, 1}};
  TestWorker worker = join("w");
  const std::string one = create(spec)->view.spec->id;
  finish_job(worker, one);
  ASSERT_TRUE(is_done(one));
  spec.name = "four";
  spec.request_id = spec.request = "request-four";
  const std::string four = create(spec)->view.spec->id;
  start_film();
  EXPECT_TRUE(work_until(worker, [&] { return is_done(four); }));
  EXPECT_EQ(digests_of(one).size(), 8u);
  EXPECT_EQ(digests_of(four), digests_of(one));
}

}  // namespace
}  // namespace tessera::server
