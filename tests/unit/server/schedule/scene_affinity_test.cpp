// Idle workers prefer jobs whose scene they have loaded; priority, fair share and progress of every
// job come first.

#include <gtest/gtest.h>

#include <chrono>
#include <string>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

struct Busy {
  WorkerKey worker = 0;
  UnitName unit;
};

/// A worker with one thread and one credit that has loaded this scene and renders a unit.
Busy connect_busy_with(SchedulerHarness& farm, const std::string& id, const std::string& scene) {
  const WorkerKey worker = farm.connect(id, {.threads = 1, .credits = 1, .tags = {id}});
  const Job& job = farm.add_job({.tiles = 1, .priority = 100, .tag = id, .scene = scene});
  const auto units = farm.leased(worker);
  EXPECT_EQ(units.size(), 1u);
  farm.scheduler.connections().scene_loaded(worker, job.spec->id, {1, 1});
  return {worker, units.at(0)};
}

/// The same, but idle.
WorkerKey connect_with(SchedulerHarness& farm, const std::string& id, const std::string& scene) {
  const Busy busy = connect_busy_with(farm, id, scene);
  farm.complete(busy.worker, busy.unit);
  return busy.worker;
}

/// Returns the job of the worker's leases; "" if it has none.
std::string job_of(SchedulerHarness& farm, WorkerKey worker) {
  const auto units = farm.leased(worker);
  return units.empty() ? "" : units.at(0).job_id;
}

TEST(SceneAffinity, PrefersWorkerWithScene) {
  SchedulerHarness farm;
  const WorkerKey has_x = connect_with(farm, "w1", "x");
  const WorkerKey has_y = connect_with(farm, "w2", "y");
  const Job& job = farm.add_job({.tiles = 1, .scene = "y"});
  EXPECT_EQ(job_of(farm, has_x), "");
  EXPECT_EQ(job_of(farm, has_y), job.spec->id);
}

TEST(SceneAffinity, WorkersPreferJobsWithTheirScene) {
  SchedulerHarness farm;
  const WorkerKey has_x = connect_with(farm, "w1", "x");
  const WorkerKey has_y = connect_with(farm, "w2", "y");
  const Job& of_y = farm.queue_job({.tiles = 4, .scene = "y"});
  const Job& of_x = farm.queue_job({.tiles = 4, .scene = "x"});
  farm.scheduler.dispatcher().dispatch_all(farm.now);
  EXPECT_EQ(job_of(farm, has_x), of_x.spec->id);
  EXPECT_EQ(job_of(farm, has_y), of_y.spec->id);
}

TEST(SceneAffinity, OldestJobDoesNotStarve) {
  SchedulerHarness farm;
  const WorkerKey first = connect_with(farm, "w1", "x");
  const WorkerKey second = connect_with(farm, "w2", "x");
  const Job& strange = farm.queue_job({.tiles = 40, .scene = "z"});
  const Job& familiar = farm.queue_job({.tiles = 40, .scene = "x"});
  farm.scheduler.dispatcher().dispatch_all(farm.now);
  EXPECT_EQ(job_of(farm, first), strange.spec->id)
      << "no worker has its scene: it is leased at once";
  EXPECT_EQ(job_of(farm, second), familiar.spec->id);
  const WorkerKey newcomer = farm.connect("w3", {.threads = 1, .credits = 1});
  EXPECT_EQ(job_of(farm, newcomer), strange.spec->id)
      << "it has no scene, so it gets the oldest job";
}

TEST(SceneAffinity, PriorityPrecedesAffinity) {
  SchedulerHarness farm;
  const Busy busy = connect_busy_with(farm, "w1", "x");
  farm.queue_job({.tiles = 40, .scene = "x"});
  const Job& urgent = farm.queue_job({.tiles = 40, .priority = 1, .scene = "z"});
  const WorkerKey other = farm.connect("w2", {.threads = 1, .credits = 1});
  EXPECT_EQ(job_of(farm, other), urgent.spec->id);
  farm.complete(busy.worker, busy.unit);
  EXPECT_EQ(job_of(farm, busy.worker), urgent.spec->id);
}

TEST(SceneAffinity, FairSharePrecedesAffinity) {
  SchedulerHarness farm;
  const Busy busy = connect_busy_with(farm, "w1", "x");
  farm.queue_job({.tiles = 40, .owner = "ann", .scene = "x"});
  const Job& of_ben = farm.queue_job({.tiles = 40, .owner = "ben", .scene = "z"});
  const WorkerKey other = farm.connect("w2", {.threads = 1, .credits = 1});
  EXPECT_EQ(job_of(farm, other), of_ben.spec->id);
  farm.complete(busy.worker, busy.unit, 100);  // ann has used much more than ben
  EXPECT_EQ(job_of(farm, busy.worker), of_ben.spec->id);
}

TEST(SceneAffinity, ReconnectedWorkerKeepsScene) {
  SchedulerHarness farm;
  const WorkerKey has_x = connect_with(farm, "w1", "x");
  const WorkerKey has_y = connect_with(farm, "w2", "y");
  farm.scheduler.connections().disconnect(has_y);
  farm.pass(std::chrono::seconds(10), {has_x});
  ASSERT_EQ(farm.connect("w2", {.threads = 1, .credits = 1}), has_y);
  const Job& job = farm.add_job({.tiles = 1, .scene = "y"});
  EXPECT_EQ(job_of(farm, has_x), "");
  EXPECT_EQ(job_of(farm, has_y), job.spec->id);
}

TEST(SceneAffinity, SceneIdIgnoresFileOrderAndNames) {
  const contract::Digest a = contract::sha256("a"), b = contract::sha256("b");
  JobSpec spec, same, more;
  spec.assets = {{"scene.gltf", a, 1}, {"bark.png", b, 1}};
  same.assets = {{"wood.png", b, 1}, {"tree.gltf", a, 1}};
  more.assets = {{"scene.gltf", a, 1}};
  EXPECT_EQ(scene_key(spec), scene_key(same));
  EXPECT_NE(scene_key(spec), scene_key(more));
}

}  // namespace
}  // namespace tessera::server
