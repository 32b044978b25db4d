// A power cut at every step of a job: the server restarts on the synced state, and no unit that the
// worker saw acknowledged is lost, leased or counted again.

#include <gtest/gtest.h>

#include <cstdio>
#include <set>
#include <string>
#include <vector>

#include "tests/support/disk/disk_model.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/power_cut/farm_on_disk.h"
#include "tests/unit/server/store/durability_checker.h"
#include "tests/unit/server/store/sync_sites.h"

namespace tessera::server {
namespace {

using testing::DiskImage;
using testing::DiskModel;

constexpr int kUnits = 24;  // 2 frames of 6 tiles in 2 passes

/// A job without failures, and the steps at which clients and workers were answered.
struct Life {
  bool uses_rows = false;
  std::vector<testing::DiskEvent> events;
  std::string job_id;
  int asset_step = 0;  // when the client was told
  int job_step = 0;
  int done_step = 0;
  FarmOnDisk::WorkerLog log;
  std::vector<std::string> pixels;  // by frame
};

void live(Life& life) {
  const ScratchFolder folder;
  FarmOnDisk farm(folder.path(), life.uses_rows);
  ASSERT_TRUE(farm.start().ok());
  const auto uploaded = farm.upload_scene();
  ASSERT_TRUE(uploaded.ok()) << uploaded.status();
  life.asset_step = *uploaded;
  const auto job = farm.submit();
  ASSERT_TRUE(job.ok()) << job.status();
  life.job_id = *job;
  life.job_step = farm.step();
  farm.connect({});
  const absl::Status done = farm.finish_job(*job);
  ASSERT_TRUE(done.ok()) << done;
  life.done_step = farm.step();
  life.log = farm.log();
  life.pixels = farm.pixels(*job);
  life.events = farm.events();
  ASSERT_EQ(life.log.size(), static_cast<std::size_t>(kUnits));
  ASSERT_EQ(life.pixels.size(), 2U);
  ASSERT_NE(life.pixels[0], life.pixels[1]);
}

/// Units that a worker with power holds at `step`: sent and unacknowledged.
FarmOnDisk::WorkerLog held_at(const Life& life, int step) {
  FarmOnDisk::WorkerLog held;
  for (const auto& [name, entry] : life.log) {
    if (entry.sent_step <= step && entry.acknowledged_step > step) held[name] = entry;
  }
  return held;
}

/// Units whose commit the worker knew at `step`.
std::set<UnitName> acknowledged_at(const Life& life, int step) {
  std::set<UnitName> units;
  for (const auto& [name, entry] : life.log) {
    const bool is_committed = entry.status == AckStatus::committed;
    if (is_committed && entry.acknowledged_step >= 0 && entry.acknowledged_step <= step)
      units.insert(name);
  }
  return units;
}

std::string text(const UnitName& name) {
  return "unit (" + std::to_string(name.unit.frame) + ", " + std::to_string(name.unit.tile) + ", " +
         std::to_string(name.unit.pass) + ")";
}

/// Starts the server on `image` and finishes the job; returns what went wrong, or an empty string.
std::string restart_on(const DiskImage& image, const Life& life, int step, bool worker_kept_power) {
  const ScratchFolder folder;
  testing::restore_image(image, folder.path());
  FarmOnDisk farm(folder.path(), life.uses_rows);
  if (absl::Status started = farm.start(); !started.ok()) return started.ToString();
  const contract::Digest scene = farm.scene_digest();
  const bool has_scene = farm.store().assets().has(scene);
  if (step >= life.asset_step && !has_scene) return "the scene is lost";
  if (has_scene && contract::sha256(read_asset(farm.store(), scene)) != scene) {
    return "the scene is damaged";
  }
  const auto uploaded = farm.upload_scene();
  if (!uploaded.ok()) return uploaded.status().ToString();
  if (step >= life.job_step && !farm.coordinator().queries().job(life.job_id).ok())
    return "the job is lost";
  if (step >= life.done_step &&
      farm.coordinator().queries().job(life.job_id)->state != JobState::done) {
    return "the job is done no more";
  }
  const auto job_id = farm.submit();
  if (!job_id.ok()) return job_id.status().ToString();
  if (step >= life.job_step && *job_id != life.job_id) return "the job was made twice";
  farm.connect(worker_kept_power ? held_at(life, step) : FarmOnDisk::WorkerLog());
  if (absl::Status done = farm.finish_job(*job_id); !done.ok()) return done.ToString();
  for (const UnitName& name : acknowledged_at(life, step)) {
    if (farm.leased().count(name) != 0) return text(name) + " was acknowledged and leased again";
  }
  const auto view = farm.coordinator().queries().job(*job_id);
  if (!view.ok()) return "the job fails";
  if (view->state != JobState::done) return "the job fails: " + view->reason;
  if (view->committed_unit_count != kUnits) return "units are counted wrongly";
  if (view->cpu_seconds != 0.5 * kUnits) return "CPU seconds are counted wrongly";
  return farm.pixels(*job_id) == life.pixels ? "" : "the pixels are others";
}

class FarmPowerCut : public ::testing::TestWithParam<bool> {};

INSTANTIATE_TEST_SUITE_P(Storage, FarmPowerCut, ::testing::Bool(),
                         [](const auto& tested) { return tested.param ? "Rows" : "Files"; });

TEST_P(FarmPowerCut, NoStepLosesAcknowledgedUnit) {
  Life life;
  life.uses_rows = GetParam();
  live(life);
  ASSERT_FALSE(HasFatalFailure());
  DiskModel disk;
  for (std::size_t i = 0; i < life.events.size(); ++i) {
    disk.apply(life.events[i]);
    const int step = static_cast<int>(i) + 1;
    ASSERT_EQ(restart_on(disk.synced(), life, step, i % 2 == 0), "") << "step " << step;
    ASSERT_EQ(restart_on(disk.torn(i), life, step, i % 2 == 1), "") << "step " << step << ", torn";
  }
}

TEST_P(FarmPowerCut, EveryRemovedSyncIsDetected) {
  Life life;
  life.uses_rows = GetParam();
  live(life);
  ASSERT_FALSE(HasFatalFailure());
  const std::vector<std::string> sites = sync_sites(life.events);
  std::set<std::string> named(sites.begin(), sites.end());
  named.erase("");
  // Losing this sync loses nothing acknowledged: it protects the store during its creation, before
  // anybody knows of it. The store's own test covers it.
  EXPECT_EQ(named.erase("file/store/store.db-journal"), 1U);
  for (const std::string& site : named) {
    DiskModel disk;
    std::string wrong;
    for (std::size_t i = 0; i < life.events.size() && wrong.empty(); ++i) {
      if (sites[i] != site) disk.apply(life.events[i]);
      const bool is_telling = !sites[i].empty() || i + 1 == life.events.size();
      if (is_telling) wrong = restart_on(disk.synced(), life, static_cast<int>(i) + 1, false);
    }
    EXPECT_NE(wrong, "") << site << " can be left out and nothing is lost";
    std::printf("without %-34s %s\n", site.c_str(), wrong.substr(0, 100).c_str());
  }
}

}  // namespace
}  // namespace tessera::server
