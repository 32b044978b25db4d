#include "server/schedule/queue/job_queue.h"

#include <gtest/gtest.h>

namespace tessera::server {
namespace {

const SceneKey a_scene = contract::sha256("a scene");

const std::set<std::string> no_tags;
const std::function<bool(JobKey)> is_any = [](JobKey) { return true; };
const JobQueue::Seeker anyone{no_tags, is_any};

/// The job that a worker without tags gets next, if it may work for all but `excluded`.
JobKey next(JobQueue& queue, JobKey excluded = 0) {
  const std::function<bool(JobKey)> may = [&](JobKey job) { return job != excluded; };
  return queue.next({no_tags, may});
}

TEST(JobQueue, OrdersByPriorityUsageAndAge) {
  JobQueue queue;
  queue.insert(1, {0, "ann", a_scene});
  queue.insert(2, {0, "ben", a_scene});
  queue.insert(3, {0, "ben", a_scene});
  queue.insert(4, {7, "cleo", a_scene});
  EXPECT_EQ(next(queue), 4);
  queue.erase(4, {7, "cleo", a_scene});
  EXPECT_EQ(next(queue), 1) << "equal usage: by name";
  queue.charge("ann", 10);
  EXPECT_EQ(next(queue), 2) << "ben has used less; his oldest job";
  queue.charge("ben", 11);
  EXPECT_EQ(next(queue), 1);
}

TEST(JobQueue, IneligibleJobDoesNotBlockOthers) {
  JobQueue queue;
  queue.insert(1, {9, "ann", a_scene});
  queue.insert(2, {0, "ann", a_scene});
  EXPECT_EQ(next(queue, 1), 2);
  EXPECT_TRUE(queue.has_above(0, anyone));
  const std::function<bool(JobKey)> not_first = [](JobKey job) { return job != 1; };
  EXPECT_FALSE(queue.has_above(0, {no_tags, not_first}));
  EXPECT_FALSE(queue.has_above(9, anyone));
}

TEST(JobQueue, ErasingUnknownJobIsHarmless) {
  JobQueue queue;
  queue.insert(1, {0, "ann", a_scene});
  queue.erase(2, {0, "ann", a_scene});
  queue.erase(1, {0, "ann", a_scene});
  queue.erase(1, {0, "ann", a_scene});
  EXPECT_TRUE(queue.empty());
  EXPECT_EQ(next(queue), 0);
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
  const std::function<bool(JobKey)> not_fourth = [](JobKey job) { return job != 4; };
  EXPECT_EQ(queue.oldest({0, "ann", a_scene}, anyone), 4);
  EXPECT_EQ(queue.oldest({0, "ann", a_scene}, {no_tags, not_fourth}), 5);
  EXPECT_EQ(queue.oldest({0, "bea", a_scene}, anyone), 0);
  EXPECT_EQ(queue.oldest({4, "zoe", a_scene}, anyone), 0);
  queue.erase(1, {0, "ann", other});
  EXPECT_FALSE(queue.has_scene(other));
  EXPECT_EQ(queue.oldest({0, "ann", other}, anyone), 0);
}

}  // namespace
}  // namespace tessera::server
