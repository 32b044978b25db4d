// A power cut at every step: the disk is rebuilt from the synced data, and the store must still
// have everything it confirmed. Then each kind of sync is removed in turn, which must cause a loss.

#include "tests/support/disk/power_cut.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/store/store.h"
#include "tests/support/disk/disk_model.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/store/durability_checker.h"
#include "tests/unit/server/store/sync_sites.h"

namespace tessera::server {
namespace {

using testing::DiskEvent;
using testing::DiskImage;
using testing::DiskModel;
using testing::PowerCutDisk;

constexpr std::int64_t kHourUs = std::int64_t{3600} * 1'000'000;

std::string some_bytes(int seed, int count) {
  std::mt19937 rng(static_cast<std::mt19937::result_type>(seed));
  std::string bytes(static_cast<std::size_t>(count), '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng() & 0xff);
  return bytes;
}

StoreOptions small_options() {
  StoreOptions options = files_only();
  options.segment_bytes = 3000;   // a few blocks
  options.checkpoint_pages = 24;  // a few commits
  options.slack_pages = 0;        // no slack: at most a quarter of the file
  options.now_us = [] { return kHourUs; };
  options.fatal = [](const std::string& message) { ADD_FAILURE() << message; };
  return options;
}

/// Uses a store on a recording disk and records its confirmations.
class Coordinator {
 public:
  Coordinator(PowerCutDisk& disk, std::string root, DurabilityChecker& confirmations)
      : disk_(disk), root_(std::move(root)), confirmations_(confirmations) {}

  Store& store() { return *store_; }
  int step() const { return static_cast<int>(disk_.events().size()); }

  void open() {
    auto store = Store::open(root_ + "/store", disk_, small_options());
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
    confirmations_.make("boot", step(),
                        booted_before(store_->boot_count(), store_->id(), store_->key()));
  }

  void close() { store_.reset(); }

  void add_job(const std::string& id) {
    JobRecord job;
    job.id = id;
    job.request_id = "request of " + id;
    job.request = some_bytes(1, 300);
    ASSERT_TRUE(store_->jobs().add(job).ok());
    confirmations_.make("job " + id, step(), has_job(job));
    confirmations_.make("id of " + id, step(), id_is_taken(id));
    confirmations_.make("sequence of " + id, step(), sequence_was_used(job.sequence));
    jobs_[id] = job;
  }

  void update_job(const std::string& id, std::int32_t state) {
    JobRecord& job = jobs_[id];
    job.state = state;
    job.reason = "state " + std::to_string(state);
    job.wall_seconds += 1.5;
    confirmations_.end("job " + id, step());
    ASSERT_TRUE(store_->jobs().update(job).ok());
    confirmations_.make("job " + id, step(), has_job(job));
  }

  void remove_job(const std::string& id) {
    for (const char* kind : {"job ", "unit ", "frame ", "work "})
      confirmations_.end_all(kind + id, step());
    ASSERT_TRUE(store_->jobs().remove(id).ok());
  }

  /// Commits tiles [first, first + count) of pass `pass` to each of `ids`, as one group.
  void commit(const std::vector<std::string>& ids, int first, int count, int pass) {
    std::vector<Commit> group;
    for (const std::string& id : ids) {
      for (int tile = first; tile < first + count; ++tile) {
        group.push_back(make_commit(id, {0, tile, pass}, some_bytes(++block_seed_, 700)));
      }
    }
    for (const std::string& id : ids) confirmations_.end("work " + id, step());
    ASSERT_TRUE(store_->units().commit(group).ok());
    for (const Commit& commit : group) {
      confirmations_.make(unit_key(commit.job_id, commit.record.unit), step(),
                          has_unit(commit.job_id, commit.record.unit, commit.block));
    }
    for (const std::string& id : ids) {
      unit_counts_[id] += count;
      confirmations_.make("work " + id, step(), counts_units(id, unit_counts_[id]));
    }
  }

  void drop(const std::string& id, contract::Unit unit) {
    confirmations_.end(unit_key(id, unit), step());
    confirmations_.end("work " + id, step());
    ASSERT_TRUE(store_->units().drop(id, {unit}).ok());
    confirmations_.make("work " + id, step(), counts_units(id, --unit_counts_[id]));
  }

  void finish_frame(const std::string& id, int frame) {
    const std::string bytes = some_bytes(100 + frame, 2000);
    FrameRecord record;
    record.frame = frame;
    record.file = "image." + std::to_string(frame) + ".exr";
    record.file_sha256 = contract::sha256(bytes);
    record.pixels_sha256 = contract::sha256("pixels");
    record.statistics_json = "{}";
    const auto folder = store_->frames().output_folder(id);
    ASSERT_TRUE(folder.ok());
    const std::string part = *folder + "/" + record.file + ".part";
    auto file = disk_.open(part);
    ASSERT_TRUE(file.ok());
    ASSERT_TRUE((*file)->append(bytes).ok());
    ASSERT_TRUE(disk_.rename(part, *folder + "/" + record.file).ok());
    ASSERT_TRUE(store_->frames().finish(id, record).ok());
    confirmations_.make("frame " + id + " " + record.file, step(), has_frame(id, record, bytes));
  }

  void close_job(const std::string& id) {
    confirmations_.end_all("unit " + id, step());
    ASSERT_TRUE(store_->units().close_job(id).ok());
  }

  void join(const std::string& worker) {
    ASSERT_TRUE(store_->workers().record_join({worker, "token", "rack"}, 0).ok());
    confirmations_.make("join " + worker, step(), worker_has_joined(worker));
  }

  void remove_stale_joins() {
    confirmations_.end_all("join ", step());
    ASSERT_TRUE(store_->workers().remove_stale_joins({}, 2 * kHourUs).ok());
  }

  void upload(const std::string& bytes) {
    const auto path = store_->assets().new_upload_path();
    ASSERT_TRUE(path.ok());
    auto file = disk_.open(*path);
    ASSERT_TRUE(file.ok());
    const std::size_t half = bytes.size() / 2;
    ASSERT_TRUE((*file)->append(std::string_view(bytes).substr(0, half)).ok());
    ASSERT_TRUE((*file)->append(std::string_view(bytes).substr(half)).ok());
    ASSERT_TRUE(store_->assets().publish(*path, contract::sha256(bytes)).ok());
    confirmations_.make("asset " + contract::sha256(bytes).hex(), step(), has_asset(bytes));
  }

  /// Adds an asset as a row, unlike upload().
  void add_asset(const std::string& bytes) {
    ASSERT_TRUE(store_->assets().add(contract::sha256(bytes), bytes).ok());
    confirmations_.make("asset " + contract::sha256(bytes).hex(), step(), has_asset(bytes));
  }

  void collect_all_assets_but(const std::string& kept, const std::vector<std::string>& evicted) {
    for (const std::string& bytes : evicted) {
      confirmations_.end("asset " + contract::sha256(bytes).hex(), step());
    }
    const std::int64_t now = 3 * kHourUs;
    ASSERT_TRUE(store_->assets().collect(now, 0, {contract::sha256(kept)}).ok());
  }

  void add_worker(const std::string& id) {
    ASSERT_TRUE(store_->workers().add_worker(id, "name").ok());
    confirmations_.make("worker " + id, step(), worker_is_known(id));
  }

  void remove_worker(const std::string& id) {
    confirmations_.end("worker " + id, step());
    ASSERT_TRUE(store_->workers().remove_worker(id).ok());
  }

 private:
  static std::string unit_key(const std::string& id, const contract::Unit& unit) {
    return "unit " + id + " " + std::to_string(unit.tile) + "." + std::to_string(unit.pass);
  }

  PowerCutDisk& disk_;
  std::string root_;
  DurabilityChecker& confirmations_;
  std::unique_ptr<Store> store_;
  std::map<std::string, JobRecord> jobs_;
  std::map<std::string, std::int64_t> unit_counts_;
  int block_seed_ = 0;
};

/// Two assets whose digests start with the same byte share a folder, one does not. One is a row.
std::vector<std::string> make_assets() {
  std::vector<std::string> assets = {some_bytes(1000, 900)};
  const int byte = contract::sha256(assets[0]).bytes[0];
  bool has_other = false;
  for (int seed = 1001; assets.size() < 3; ++seed) {
    std::string bytes = some_bytes(seed, 900);
    const bool shares = contract::sha256(bytes).bytes[0] == byte;
    if (!shares && has_other) continue;
    has_other = has_other || !shares;
    assets.push_back(std::move(bytes));
  }
  assets.push_back(some_bytes(2000, 900));
  return assets;
}

/// A recording of every operation of a store, with each step of the disk.
struct Recording {
  std::vector<DiskEvent> events;
  DurabilityChecker confirmations;
  std::vector<std::string> assets = make_assets();  // files, and the last one a row
};

void use_all_operations(Coordinator& farm, const std::vector<std::string>& assets) {
  farm.open();
  farm.add_job("a");
  farm.upload(assets[0]);
  farm.add_asset(assets[3]);
  farm.add_worker("w1");
  farm.commit({"a"}, 0, 3, 0);
  farm.add_job("b");
  farm.commit({"a", "b"}, 3, 2, 0);
  farm.update_job("a", 2);
  farm.drop("a", {0, 1, 0});
  farm.commit({"a"}, 1, 1, 0);
  farm.upload(assets[1]);
  farm.finish_frame("a", 0);
  farm.close_job("a");
  farm.commit({"a"}, 0, 2, 1);
  farm.join("w1");
  farm.close();

  farm.open();
  farm.commit({"a", "b"}, 5, 2, 1);
  farm.remove_job("b");
  farm.add_job("c");
  farm.add_worker("w2");
  farm.remove_worker("w1");
  for (int i = 0; i < 8; ++i) farm.commit({"c"}, i, 1, 0);
  farm.upload(assets[2]);
  farm.collect_all_assets_but(assets[2], {assets[0], assets[1], assets[3]});
  farm.upload(assets[0]);
  farm.add_asset(assets[3]);
  farm.finish_frame("c", 7);
  farm.close_job("c");
  farm.remove_stale_joins();
  farm.update_job("c", 4);
  farm.close();
}

Recording record_a_day() {
  Recording recording;
  const ScratchFolder folder;
  PowerCutDisk disk(folder.path());
  Coordinator farm(disk, folder.path(), recording.confirmations);
  use_all_operations(farm, recording.assets);
  recording.events = disk.events();
  return recording;
}

/// Opens a store on a disk image and returns what is wrong with it.
class Inspector {
 public:
  explicit Inspector(const Recording& recording) : recording_(recording) {}

  std::string check(const DiskImage& image, int step) {
    testing::restore_image(image, folder_.path());
    PowerCutDisk disk(folder_.path());
    auto store = Store::open(folder_.path() + "/store", disk, small_options());
    if (!store.ok()) return "cannot be opened: " + store.status().ToString();
    if (std::string wrong = check_store(**store, folder_.path() + "/store", recording_.assets);
        !wrong.empty())
      return wrong;
    if (std::string wrong = recording_.confirmations.check(**store, step); !wrong.empty())
      return wrong;
    return can_go_on(**store);
  }

 private:
  static std::string can_go_on(Store& store) {
    JobRecord job;
    job.id = "afterwards";
    if (absl::Status added = store.jobs().add(job); !added.ok()) return added.ToString();
    std::vector<Commit> group = {make_commit(job.id, {1, 2, 3}, "a block")};
    if (absl::Status added = store.units().commit(group); !added.ok()) return added.ToString();
    return has_unit(job.id, {1, 2, 3}, "a block")(store);
  }

  const Recording& recording_;
  ScratchFolder folder_;
};

/// Steps at which a missing sync is most likely to show: just before and after each sync, and when
/// the store has just confirmed something.
std::set<int> telling_steps(const Recording& recording) {
  const std::vector<int> confirmed = recording.confirmations.steps();
  std::set<int> steps(confirmed.begin(), confirmed.end());
  const std::vector<std::string> sites = sync_sites(recording.events);
  for (std::size_t i = 0; i < recording.events.size(); ++i) {
    if (sites[i].empty()) continue;
    steps.insert(static_cast<int>(i));
    steps.insert(static_cast<int>(i) + 1);
  }
  return steps;
}

/// Returns what the store loses in a power cut just after some step if the syncs of `site` never
/// happened; empty if it loses nothing.
std::string loss_without(const Recording& recording, const std::string& site) {
  constexpr std::uint64_t kRounds = 12;
  Inspector inspector(recording);
  const std::set<int> steps = telling_steps(recording);
  const std::vector<std::string> sites = sync_sites(recording.events);
  for (std::uint64_t round = 0; round < kRounds; ++round) {
    DiskModel disk;
    for (std::size_t i = 0; i < recording.events.size(); ++i) {
      if (sites[i] != site) disk.apply(recording.events[i]);
      const int step = static_cast<int>(i) + 1;
      if (steps.count(step) == 0) continue;
      const DiskImage image = round == 0 ? disk.synced() : disk.torn(round * 10'000 + i);
      const std::string wrong = inspector.check(image, step);
      if (!wrong.empty()) return "step " + std::to_string(step) + ": " + wrong;
    }
  }
  return "";
}

TEST(PowerCut, NoStepLosesConfirmedData) {
  const Recording recording = record_a_day();
  Inspector inspector(recording);
  DiskModel disk;
  for (std::size_t i = 0; i < recording.events.size(); ++i) {
    disk.apply(recording.events[i]);
    const int step = static_cast<int>(i) + 1;
    ASSERT_EQ(inspector.check(disk.synced(), step), "") << "step " << step;
    for (std::uint64_t seed = 0; seed < 2; ++seed) {
      ASSERT_EQ(inspector.check(disk.torn(2 * i + seed), step), "")
          << "step " << step << " torn by " << 2 * i + seed;
    }
  }
}

TEST(PowerCut, EverySyncIsNeeded) {
  const Recording recording = record_a_day();
  const std::vector<std::string> all_sites = sync_sites(recording.events);
  std::set<std::string> sites(all_sites.begin(), all_sites.end());
  sites.erase("");
  for (const std::string& site : sites) {
    const std::string loss = loss_without(recording, site);
    EXPECT_NE(loss, "") << site << " can be left out and nothing is lost";
    std::printf("without %-34s %s\n", site.c_str(), loss.substr(0, 120).c_str());
  }
}

TEST(PowerCut, KillThenCutKeepsObservedData) {
  const Recording recording = record_a_day();
  const ScratchFolder killed_folder;
  const ScratchFolder cut_folder;
  DiskModel disk;
  for (std::size_t i = 0; i < recording.events.size(); ++i) {
    disk.apply(recording.events[i]);
    testing::restore_image(disk.visible(), killed_folder.path());
    DiskModel second_disk = disk;
    DurabilityChecker confirmations;
    std::vector<std::string> seen;
    {
      PowerCutDisk second(killed_folder.path());
      Coordinator farm(second, killed_folder.path(), confirmations);
      farm.open();
      seen = facts(farm.store());
      farm.add_job("late");
      farm.commit({"late"}, 0, 1, 0);
      farm.upload(recording.assets[1]);
      farm.finish_frame("late", 0);
      for (const DiskEvent& event : second.events()) second_disk.apply(event);
      ASSERT_FALSE(HasFatalFailure());
    }
    testing::restore_image(second_disk.synced(), cut_folder.path());
    PowerCutDisk third(cut_folder.path());
    auto store = Store::open(cut_folder.path() + "/store", third, small_options());
    ASSERT_TRUE(store.ok()) << store.status() << " at step " << i + 1;
    ASSERT_EQ(check_store(**store, cut_folder.path() + "/store", recording.assets), "")
        << "step " << i + 1;
    ASSERT_EQ(confirmations.check(**store, 1 << 30), "") << "step " << i + 1;
    const std::vector<std::string> kept = facts(**store);
    const std::set<std::string> kept_set(kept.begin(), kept.end());
    for (const std::string& fact : seen) {
      ASSERT_EQ(kept_set.count(fact), 1U) << fact << " was shown and lost, step " << i + 1;
    }
  }
}

}  // namespace
}  // namespace tessera::server
