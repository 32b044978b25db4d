// Jobs of which the store has lost a scene file.
#include <string>
#include <utility>
#include <vector>

#include "contract/digest.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

constexpr char kScene[] = "the bytes of a scene";

class LostScene : public CoordinatorFixture {
 protected:
  contract::Digest scene() const { return contract::sha256(kScene); }
  std::string job_with_scene() {
    EXPECT_TRUE(store.assets().add(scene(), kScene).ok());
    JobSpec spec = spec_of("a");
    spec.scene_uri = "scene.glb";
    spec.assets = {{"scene.glb", scene(), sizeof(kScene) - 1}};
    const auto created = create(spec);
    EXPECT_TRUE(created.ok()) << created.status();
    return created->view.spec->id;
  }
  /// The worker's download finds that the store has lost the scene, so it returns its units.
  void fail_to_fetch(TestWorker& worker) {
    collect(worker);
    EXPECT_FALSE(coordinator->assets().has_asset(scene()));
    coordinator->assets().note_lost(scene());
    std::vector<UnitName> units;
    for (const Leased& unit : std::exchange(worker.units, {})) units.push_back(unit.name);
    coordinator->workers().return_units(worker.session, units, true);
    collect(worker);
  }
  void load(TestWorker& worker, const std::string& job) {
    coordinator->workers().scene_loaded(worker.session, job, {});
  }
  void upload() {
    coordinator->assets().add_asset(scene(), kScene, [](const absl::Status&) {});
    pump();
  }
};

TEST_F(LostScene, JobWaitsAndSaysWhy) {
  const std::string job = job_with_scene();
  store.assets().lose(scene());
  auto one = join("w1"), two = join("w2");
  fail_to_fetch(one);
  EXPECT_TRUE(one.units.empty()) << "the worker would return them again";
  fail_to_fetch(two);
  EXPECT_TRUE(two.units.empty());
  EXPECT_EQ(view(job).reason,
            "the store has lost its scene file scene.glb; submit the scene again");
  EXPECT_EQ(view(job).leased_unit_count, 0);
  auto late = join("w3");
  EXPECT_TRUE(late.units.empty());
}

TEST_F(LostScene, JobContinuesAfterUpload) {
  const std::string job = job_with_scene();
  store.assets().lose(scene());
  auto worker = join("w1");
  fail_to_fetch(worker);
  upload();
  EXPECT_EQ(view(job).reason, "");
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_TRUE(view(job).failed_attempts.empty());
}

TEST_F(LostScene, DamagedFileIsLostUntilNextUpload) {
  const std::string job = job_with_scene();
  auto worker = join("w1");
  const std::int64_t damaged_us = coordinator->assets().open_asset(scene())->stored_us();
  const auto drop = [&] {  // as the download of a worker does
    coordinator->assets().drop_damaged(
        scene(), damaged_us, [](const absl::Status& dropped) { EXPECT_TRUE(dropped.ok()); });
    pump();
  };
  drop();
  EXPECT_NE(view(job).reason.find("lost its scene file scene.glb"), std::string::npos);
  fail_to_fetch(worker);
  EXPECT_TRUE(worker.units.empty());
  upload();
  drop();  // by a download that began before the upload
  EXPECT_EQ(view(job).reason, "");
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
}

TEST_F(LostScene, WorkerThatHasItGoesOn) {
  const std::string job = job_with_scene();
  auto holder = join("w1", 2);
  load(holder, job);
  store.assets().lose(scene());
  auto other = join("w2");
  fail_to_fetch(other);
  EXPECT_TRUE(other.units.empty());
  EXPECT_EQ(view(job).reason, "");
  finish_job(holder, job);
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(LostScene, WorkerThatHasDroppedItIsNotAskedAgain) {
  const std::string job = job_with_scene();
  auto worker = join("w1");
  load(worker, job);
  store.assets().lose(scene());
  fail_to_fetch(worker);
  EXPECT_TRUE(worker.units.empty());
  EXPECT_NE(view(job).reason.find("lost its scene file"), std::string::npos);
}

TEST_F(LostScene, FileThatIsBackInTimeIsNotLost) {
  const std::string job = job_with_scene();
  auto worker = join("w1");
  coordinator->assets().note_lost(scene());  // stored since it was asked for
  auto late = join("w2");
  EXPECT_EQ(view(job).reason, "");
  EXPECT_FALSE(late.units.empty() && worker.units.empty());
}

}  // namespace
}  // namespace tessera::server
