#include "server/schedule/job_queue.h"

#include <gtest/gtest.h>

namespace tessera::server {
namespace {

bool is_any(JobKey) {
  return true;
}

TEST(JobQueue, PriorityThenLeastUsageThenAge) {
  JobQueue queue;
  queue.insert(1, 0, "ann");
  queue.insert(2, 0, "ben");
  queue.insert(3, 0, "ben");
  queue.insert(4, 7, "cleo");
  EXPECT_EQ(queue.next(is_any), 4);
  queue.erase(4, 7, "cleo");
  EXPECT_EQ(queue.next(is_any), 1) << "equal usage: by name";
  queue.charge("ann", 10);
  EXPECT_EQ(queue.next(is_any), 2) << "ben has used less; his oldest job";
  queue.charge("ben", 11);
  EXPECT_EQ(queue.next(is_any), 1);
}

TEST(JobQueue, AJobNobodyMayWorkForHoldsUpNoOther) {
  JobQueue queue;
  queue.insert(1, 9, "ann");
  queue.insert(2, 0, "ann");
  EXPECT_EQ(queue.next([](JobKey job) { return job != 1; }), 2);
  EXPECT_TRUE(queue.has_above(0, is_any));
  EXPECT_FALSE(queue.has_above(0, [](JobKey job) { return job != 1; }));
  EXPECT_FALSE(queue.has_above(9, is_any));
}

TEST(JobQueue, ErasingTwiceOrTheUnknownIsHarmless) {
  JobQueue queue;
  queue.insert(1, 0, "ann");
  queue.erase(2, 0, "ann");
  queue.erase(1, 0, "ann");
  queue.erase(1, 0, "ann");
  EXPECT_TRUE(queue.empty());
  EXPECT_EQ(queue.next(is_any), 0);
}

}  // namespace
}  // namespace tessera::server
