#include "server/schedule/job_queue.h"

#include <gtest/gtest.h>

namespace tessera::server {
namespace {

const auto kAny = [](JobKey) { return true; };

TEST(JobQueue, PriorityThenLeastUsageThenAge) {
  JobQueue queue;
  queue.insert(1, 0, "ann");
  queue.insert(2, 0, "ben");
  queue.insert(3, 0, "ben");
  queue.insert(4, 7, "cleo");
  EXPECT_EQ(queue.next(kAny), 4);
  queue.erase(4, 7, "cleo");
  EXPECT_EQ(queue.next(kAny), 1) << "equal usage: by name";
  queue.charge("ann", 10);
  EXPECT_EQ(queue.next(kAny), 2) << "ben has used less; his oldest job";
  queue.charge("ben", 11);
  EXPECT_EQ(queue.next(kAny), 1);
}

TEST(JobQueue, AJobNobodyMayWorkForHoldsUpNoOther) {
  JobQueue queue;
  queue.insert(1, 9, "ann");
  queue.insert(2, 0, "ann");
  EXPECT_EQ(queue.next([](JobKey job) { return job != 1; }), 2);
  EXPECT_TRUE(queue.has_above(0, kAny));
  EXPECT_FALSE(queue.has_above(0, [](JobKey job) { return job != 1; }));
  EXPECT_FALSE(queue.has_above(9, kAny));
}

TEST(JobQueue, ErasingTwiceOrTheUnknownIsHarmless) {
  JobQueue queue;
  queue.insert(1, 0, "ann");
  queue.erase(2, 0, "ann");
  queue.erase(1, 0, "ann");
  queue.erase(1, 0, "ann");
  EXPECT_TRUE(queue.empty());
  EXPECT_EQ(queue.next(kAny), 0);
}

}  // namespace
}  // namespace tessera::server
