#include "server/schedule/job_queue.h"

#include <gtest/gtest.h>

namespace tessera::server {
namespace {

const SceneKey a_scene = contract::sha256("a scene");

bool is_any(JobKey) {
  return true;
}

TEST(JobQueue, OrdersByPriorityUsageAndAge) {
  JobQueue queue;
  queue.insert(1, {0, "ann", a_scene});
  queue.insert(2, {0, "ben", a_scene});
  queue.insert(3, {0, "ben", a_scene});
  queue.insert(4, {7, "cleo", a_scene});
  EXPECT_EQ(queue.next(is_any), 4);
  queue.erase(4, {7, "cleo", a_scene});
  EXPECT_EQ(queue.next(is_any), 1) << "equal usage: by name";
  queue.charge("ann", 10);
  EXPECT_EQ(queue.next(is_any), 2) << "ben has used less; his oldest job";
  queue.charge("ben", 11);
  EXPECT_EQ(queue.next(is_any), 1);
}

TEST(JobQueue, IneligibleJobDoesNotBlockOthers) {
  JobQueue queue;
  queue.insert(1, {9, "ann", a_scene});
  queue.insert(2, {0, "ann", a_scene});
  EXPECT_EQ(queue.next([](JobKey job) { return job != 1; }), 2);
  EXPECT_TRUE(queue.has_above(0, is_any));
  EXPECT_FALSE(queue.has_above(0, [](JobKey job) { return job != 1; }));
  EXPECT_FALSE(queue.has_above(9, is_any));
}

TEST(JobQueue, ErasingUnknownJobIsHarmless) {
  JobQueue queue;
  queue.insert(1, {0, "ann", a_scene});
  queue.erase(2, {0, "ann", a_scene});
  queue.erase(1, {0, "ann", a_scene});
  queue.erase(1, {0, "ann", a_scene});
  EXPECT_TRUE(queue.empty());
  EXPECT_EQ(queue.next(is_any), 0);
  EXPECT_FALSE(queue.has_scene(a_scene));
}

TEST(JobQueue, FindsOldestJobOfSceneAndOwner) {
  const SceneKey other = contract::sha256("other");
  JobQueue queue;
  queue.insert(1, {0, "ann", other});
  queue.insert(2, {0, "ben", a_scene});
  queue.insert(3, {5, "ann", a_scene});
  queue.insert(4, {0, "ann", a_scene});
  queue.insert(5, {0, "ann", a_scene});
  EXPECT_EQ(queue.oldest({0, "ann", a_scene}, is_any), 4);
  EXPECT_EQ(queue.oldest({0, "ann", a_scene}, [](JobKey job) { return job != 4; }), 5);
  EXPECT_EQ(queue.oldest({0, "bea", a_scene}, is_any), 0);
  EXPECT_EQ(queue.oldest({4, "zoe", a_scene}, is_any), 0);
  queue.erase(1, {0, "ann", other});
  EXPECT_FALSE(queue.has_scene(other));
  EXPECT_EQ(queue.oldest({0, "ann", other}, is_any), 0);
}

}  // namespace
}  // namespace tessera::server
