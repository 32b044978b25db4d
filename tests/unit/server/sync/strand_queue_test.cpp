#include "server/sync/strand_queue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <future>
#include <string>
#include <thread>
#include <vector>

namespace tessera::server {
namespace {

using Queue = StrandQueue<std::string>;

constexpr Queue::Limits kLimits{2, 100};

/// Threads that run the tasks of a queue until the end of the scope.
class Threads {
 public:
  Threads(Queue& queue, int count) : queue_(queue) {
    for (int i = 0; i < count; ++i) {
      threads_.emplace_back([this] {
        while (!is_over_) queue_.run(true);
      });
    }
  }
  ~Threads() {
    is_over_ = true;
    queue_.stop();
    for (std::thread& thread : threads_) thread.join();
  }

 private:
  Queue& queue_;
  std::atomic<bool> is_over_ = false;
  std::vector<std::thread> threads_;
};

/// Something that threads wait for.
class Event {
 public:
  void happen() {
    if (!has_happened_.exchange(true)) promise_.set_value();
  }
  /// Returns false if it does not happen.
  bool wait() { return future_.wait_for(std::chrono::minutes(1)) == std::future_status::ready; }

 private:
  std::atomic<bool> has_happened_ = false;
  std::promise<void> promise_;
  std::shared_future<void> future_{promise_.get_future()};
};

TEST(StrandQueue, SingleThreadRunsTasksInPostedOrder) {
  Queue queue(kLimits);
  std::vector<int> order;
  const auto note = [&order](int number) { return [&order, number] { order.push_back(number); }; };
  queue.post("a", note(0));
  queue.post("b", note(1), 60);
  queue.post("a", note(2), 1000);
  queue.post("c", [&] {
    order.push_back(3);
    queue.post("a", note(6));
  });
  queue.post("b", note(4));
  queue.post("d", note(5), 60);
  EXPECT_EQ(queue.size(), 6u);
  EXPECT_TRUE(queue.run(false));
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(queue.size(), 1u) << "posted during the round";
  EXPECT_TRUE(queue.run(false));
  EXPECT_FALSE(queue.run(false));
  EXPECT_EQ(order.back(), 6);
}

TEST(StrandQueue, NextTasksRunBeforeWaitingOnes) {
  Queue queue(kLimits);
  std::string order;
  queue.post("a", [&] {
    order += '1';
    queue.post_next("a", [&] {
      order += '2';
      queue.post_next("a", [&] { order += '3'; });
    });
    queue.post_next(
        "a", [&] { order += '4'; }, 1000);
  });
  queue.post("b", [&] { order += '6'; });
  queue.post("a", [&] { order += '5'; });
  EXPECT_TRUE(queue.run(false));
  EXPECT_EQ(order, "123465");
  EXPECT_EQ(queue.size(), 0u);
}

TEST(StrandQueue, TasksOfAKeyKeepOrderWithFourThreads) {
  constexpr int kTasks = 2000;
  const std::array<std::string, 5> keys = {"a", "b", "c", "d", "e"};
  std::array<std::vector<int>, 5> seen;  // without a lock: only one task of a key runs at a time
  std::atomic<int> left = 5 * kTasks;
  Event over;
  Queue queue(kLimits);
  {
    const Threads threads(queue, 4);
    for (int i = 0; i < kTasks; i += 2) {
      for (std::size_t k = 0; k < keys.size(); ++k) {
        const auto note = [&seen, &left, &over, k](int number) {
          seen[k].push_back(number);
          if (--left == 0) over.happen();
        };
        queue.post(
            keys[k],
            [&queue, &keys, note, i, k] {
              note(i);
              queue.post_next(keys[k], [note, i] { note(i + 1); });
            },
            static_cast<std::int64_t>(k) * 30);
      }
    }
    EXPECT_TRUE(over.wait());
  }
  for (const std::vector<int>& numbers : seen) {
    ASSERT_EQ(numbers.size(), std::size_t{kTasks});
    for (int i = 0; i < kTasks; ++i) ASSERT_EQ(numbers[static_cast<std::size_t>(i)], i);
  }
  EXPECT_TRUE(queue.keys("a", "e").empty());
}

TEST(StrandQueue, TasksOfOtherKeysRunMeanwhile) {
  Queue queue(kLimits);
  Event has_started, may_end, over;
  const Threads threads(queue, 2);
  queue.post("a", [&] {
    has_started.happen();
    EXPECT_TRUE(may_end.wait());
  });
  EXPECT_TRUE(has_started.wait());
  std::atomic<bool> is_second_done = false;
  queue.post("a", [&] {
    is_second_done = true;
    over.happen();
  });
  queue.post("b", [&] {
    EXPECT_FALSE(is_second_done) << "the first task of its key still runs";
    EXPECT_EQ(queue.keys("a", "b").size(), 2u);
    may_end.happen();
  });
  EXPECT_TRUE(over.wait());
}

/// Posts large tasks of these sizes, which run until a small one that is posted last has run, and
/// expects that `count` of them run at the same time.
void expect_together(const std::vector<std::int64_t>& sizes, int count) {
  Queue queue(kLimits);
  std::atomic<int> running = 0, most = 0;
  std::atomic<std::size_t> ended = 0;
  Event started, small_ran, over;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const auto task = [&] {
      const int now = ++running;
      most = std::max(most.load(), now);
      if (now == count) started.happen();
      EXPECT_TRUE(small_ran.wait());
      --running;
      if (++ended == sizes.size()) over.happen();
    };
    queue.post(std::to_string(i), task, sizes[i]);
  }
  queue.post("small", [&] {  // a thread takes it when no large one may start
    EXPECT_TRUE(started.wait());
    small_ran.happen();
  });
  const Threads threads(queue, 3);
  EXPECT_TRUE(over.wait()) << "all run in the end";
  EXPECT_EQ(most, count);
}

TEST(StrandQueue, LargeTasksStayWithinBytes) {
  expect_together({60, 60, 60}, 1);
  expect_together({60, 40, 1}, 2);
}

TEST(StrandQueue, TaskAboveLimitRunsAlone) {
  expect_together({1000, 1, 1}, 1);
  expect_together({1, 1000, 1}, 1);  // the third one does not overtake it
}

TEST(StrandQueue, LargeTasksLeaveAThreadForSmallOnes) {
  expect_together({1, 1, 1, 1}, 2);
}

}  // namespace
}  // namespace tessera::server
