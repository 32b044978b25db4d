// Orders of clients (update, pause, resume, extend, cancel, retry, remove) with a crash, a power
// cut or a full disk at every step: an order is either done or not, an answered one is done, and
// the job can be finished.
#include <gtest/gtest.h>

#include <cstddef>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "tests/support/disk/disk_model.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/power_cut/farm_on_disk.h"

namespace tessera::server {
namespace {

using testing::DiskImage;
using testing::DiskModel;

constexpr int kSpp = 16, kMoreSpp = 32;  // pass 0 is the same in both, pass 1 is not

/// The properties of a job that an order can change.
struct Facts {
  bool exists = true;
  JobState state = JobState::running;  // also for a queued job
  std::int32_t spp = kSpp, priority = 0;

  bool operator==(const Facts&) const = default;
  std::string text() const {
    if (!exists) return "no job";
    return absl::StrCat("state ", static_cast<int>(state), ", spp ", spp, ", priority ", priority);
  }
};

Facts facts_of(FarmOnDisk& farm, const std::string& job_id) {
  const auto view = farm.coordinator().queries().job(job_id);
  if (!view.ok()) return {.exists = false};
  const JobState state = view->state == JobState::queued ? JobState::running : view->state;
  return {true, state, view->spec->settings.spp, view->spec->priority};
}

struct Order {
  std::string name;
  std::function<absl::Status(FarmOnDisk&, const std::string& job_id)> give;
  Facts after;
  /// Whether the server changes nothing if it cannot write. Otherwise the change is in effect, and
  /// its row is written as soon as that is possible.
  bool is_written_first = false;
};

std::vector<Order> all_orders() {
  const auto changed = [](JobAdmin::Change what) {
    return [what](FarmOnDisk& farm, const std::string& id) { return farm.change(id, what); };
  };
  const auto updated = [](FarmOnDisk& farm, const std::string& id) {
    return farm.set_priority(id, 7);
  };
  const auto extended = [](FarmOnDisk& farm, const std::string& id) {
    return farm.extend(id, kMoreSpp);
  };
  const auto removed = [](FarmOnDisk& farm, const std::string& id) { return farm.remove(id); };
  using Change = JobAdmin::Change;
  return {{"update", updated, {true, JobState::running, kSpp, 7}, true},
          {"pause", changed(Change::pause), {true, JobState::paused, kSpp, 7}},
          {"resume", changed(Change::resume), {true, JobState::running, kSpp, 7}},
          {"extend", extended, {true, JobState::running, kMoreSpp, 7}, true},
          {"cancel", changed(Change::cancel), {true, JobState::cancelled, kMoreSpp, 7}},
          {"retry", changed(Change::retry), {true, JobState::running, kMoreSpp, 7}},
          {"cancel again", changed(Change::cancel), {true, JobState::cancelled, kMoreSpp, 7}},
          {"remove", removed, {.exists = false}, true}};
}

/// Finishes the job from whatever state it is in, and returns its pixels; on failure one text.
std::vector<std::string> finished_pixels(FarmOnDisk& farm, std::string job_id) {
  const Facts facts = facts_of(farm, job_id);
  absl::Status status;
  if (!facts.exists) {
    if (const auto uploaded = farm.upload_scene(); !uploaded.ok()) status = uploaded.status();
    const auto submitted = farm.submit("another request");
    if (!submitted.ok()) return {submitted.status().ToString()};
    job_id = *submitted;
  } else if (facts.state == JobState::paused) {
    status = farm.change(job_id, JobAdmin::Change::resume);
  } else if (facts.state == JobState::cancelled) {
    status = farm.change(job_id, JobAdmin::Change::retry);
  }
  if (status.ok()) status = farm.finish_job(job_id);
  if (!status.ok()) return {status.ToString()};
  const auto view = farm.coordinator().queries().job(job_id);
  if (!view.ok() || view->state != JobState::done) return {"the job is not done"};
  return farm.pixels(job_id);
}

/// Pixels of a job without orders.
std::vector<std::string> undisturbed_pixels(std::int32_t spp) {
  const ScratchFolder folder;
  FarmOnDisk farm(folder.path(), true);
  EXPECT_TRUE(farm.start().ok());
  EXPECT_TRUE(farm.upload_scene().ok());
  const std::string job_id = farm.submit().value();
  EXPECT_TRUE(farm.extend(job_id, spp).ok());
  farm.connect({});
  return finished_pixels(farm, job_id);
}

/// A life with every order and some work between them.
struct OrderedLife {
  std::vector<testing::DiskEvent> events;
  std::string job_id;
  std::vector<Facts> facts = {Facts{}};  // before the first order, and after each
  std::vector<int> begun, answered;      // steps, by order
  int extended_step = 0;
  FarmOnDisk::WorkerLog log_before_extension, log;
};

class OrderPowerCut : public ::testing::TestWithParam<bool> {
 protected:
  static void SetUpTestSuite() {
    undisturbed = {undisturbed_pixels(kSpp), undisturbed_pixels(kMoreSpp)};
    ASSERT_EQ(undisturbed[0].size(), 2u);
    ASSERT_NE(undisturbed[0], undisturbed[1]);
  }
  static const std::vector<std::string>& expected_pixels(const Facts& facts) {
    return undisturbed.at(facts.exists && facts.spp == kMoreSpp ? 1 : 0);
  }

  static void begin(FarmOnDisk& farm, std::string& job_id) {
    ASSERT_TRUE(farm.start().ok());
    ASSERT_TRUE(farm.upload_scene().ok());
    const auto job = farm.submit();
    ASSERT_TRUE(job.ok()) << job.status();
    job_id = *job;
    farm.connect({});
    for (int i = 0; i < 4; ++i) farm.work();
  }

  static void live(OrderedLife& life, bool uses_rows) {
    const ScratchFolder folder;
    FarmOnDisk farm(folder.path(), uses_rows);
    begin(farm, life.job_id);
    for (const Order& order : all_orders()) {
      if (order.name == "extend") life.log_before_extension = farm.log();
      life.begun.push_back(farm.step());
      const absl::Status answer = order.give(farm, life.job_id);
      ASSERT_TRUE(answer.ok()) << order.name << ": " << answer;
      life.answered.push_back(farm.step());
      ASSERT_EQ(facts_of(farm, life.job_id).text(), order.after.text()) << order.name;
      life.facts.push_back(order.after);
      farm.work();
    }
    life.log = farm.log();
    life.events = farm.events();
  }

  /// Starts the server on `image` and returns what is wrong with it; empty: nothing.
  static std::string restart_on(const DiskImage& image, const OrderedLife& life, int step,
                                bool is_finished, bool uses_rows) {
    std::size_t answered = 0, begun = 0;
    while (answered < life.answered.size() && life.answered[answered] <= step) ++answered;
    while (begun < life.begun.size() && life.begun[begun] < step) ++begun;
    const ScratchFolder folder;
    testing::restore_image(image, folder.path());
    FarmOnDisk farm(folder.path(), uses_rows);
    if (absl::Status started = farm.start(); !started.ok()) return started.ToString();
    const Facts found = facts_of(farm, life.job_id);
    if (found != life.facts[answered] && found != life.facts[begun]) {
      return absl::StrCat("after ", answered, " answered and ", begun,
                          " begun orders: ", found.text());
    }
    if (!is_finished) return "";
    farm.connect({});
    const std::vector<std::string> pixels = finished_pixels(farm, life.job_id);
    if (pixels != expected_pixels(found)) {
      return absl::StrCat(found.text(), ": other pixels: ", absl::StrJoin(pixels, ", "));
    }
    for (const auto& [name, entry] : acknowledged(life, step, found)) {
      if (farm.leased().count(name) != 0) return "an acknowledged unit was leased again";
    }
    return "";
  }

  /// Units whose commit the worker knew at `step` and that the job with these facts still needs.
  static FarmOnDisk::WorkerLog acknowledged(const OrderedLife& life, int step, const Facts& facts) {
    FarmOnDisk::WorkerLog units;
    if (!facts.exists) return units;
    const bool is_extended = facts.spp == kMoreSpp;
    const auto add = [&](const FarmOnDisk::WorkerLog& log, bool is_later) {
      for (const auto& [name, entry] : log) {
        const bool is_known = entry.status == AckStatus::committed &&
                              entry.acknowledged_step >= 0 && entry.acknowledged_step <= step;
        const bool has_valid_samples = name.unit.pass == 0 || is_later == is_extended;
        if (is_known && has_valid_samples) units[name] = entry;
      }
    };
    add(life.log_before_extension, false);
    for (const auto& [name, entry] : life.log) {
      const auto before = life.log_before_extension.find(name);
      const bool is_later = before == life.log_before_extension.end() ||
                            before->second.acknowledged_step != entry.acknowledged_step;
      if (is_later) add({{name, entry}}, true);
    }
    return units;
  }

  static inline std::vector<std::vector<std::string>> undisturbed;
};

INSTANTIATE_TEST_SUITE_P(Storage, OrderPowerCut, ::testing::Bool(),
                         [](const auto& tested) { return tested.param ? "Rows" : "Files"; });

TEST_P(OrderPowerCut, EveryStepKeepsAnswers) {
  OrderedLife life;
  live(life, GetParam());
  ASSERT_FALSE(HasFatalFailure());
  DiskModel disk;
  for (std::size_t i = 0; i < life.events.size(); ++i) {
    disk.apply(life.events[i]);
    const int step = static_cast<int>(i) + 1;
    if (step < life.begun[0]) continue;  // FarmPowerCut covers them
    const auto check = [&](const DiskImage& image, bool is_finished) {
      return restart_on(image, life, step, is_finished, GetParam());
    };
    ASSERT_EQ(check(disk.synced(), i % 2 == 0), "") << "power cut at step " << step;
    ASSERT_EQ(check(disk.torn(i), i % 4 == 1), "") << "power cut at step " << step << ", torn";
    ASSERT_EQ(check(disk.visible(), i % 4 == 3), "") << "crash at step " << step;
  }
}

TEST_P(OrderPowerCut, FullDiskAtEveryWrite) {
  const std::vector<Order> orders = all_orders();
  std::set<std::string> refused;
  for (std::size_t failing = 0; failing < orders.size(); ++failing) {
    const Order& order = orders[failing];
    for (int writes = 0;; ++writes) {
      const std::string what = absl::StrCat(order.name, ", full after ", writes, " writes");
      const ScratchFolder folder;
      DiskImage left;
      std::string job_id;
      Facts before;
      absl::Status answer;
      int refused_count = 0;
      {
        FarmOnDisk farm(folder.path(), GetParam());
        begin(farm, job_id);
        ASSERT_FALSE(HasFatalFailure());
        for (std::size_t i = 0; i < failing; ++i) ASSERT_TRUE(orders[i].give(farm, job_id).ok());
        before = facts_of(farm, job_id);
        farm.disk().fill_after(writes);
        answer = order.give(farm, job_id);
        refused_count = farm.disk().refused_count();
        const bool is_changed = answer.ok() || !order.is_written_first;
        ASSERT_EQ(facts_of(farm, job_id).text(), (is_changed ? order.after : before).text())
            << what;
        farm.disk().set_full(false);
        DiskModel disk;
        for (const testing::DiskEvent& event : farm.events()) disk.apply(event);
        left = disk.visible();
      }
      const ScratchFolder restarted;
      testing::restore_image(left, restarted.path());
      FarmOnDisk farm(restarted.path(), GetParam());
      ASSERT_TRUE(farm.start().ok()) << what;
      const Facts found = facts_of(farm, job_id);
      ASSERT_EQ(found.text(), (answer.ok() ? order.after : before).text())
          << what << ": " << answer;
      farm.connect({});
      ASSERT_EQ(finished_pixels(farm, job_id), expected_pixels(found)) << what;
      if (!answer.ok()) {
        EXPECT_EQ(answer.code(), absl::StatusCode::kResourceExhausted) << what << ": " << answer;
        refused.insert(order.name);
      }
      if (refused_count == 0) break;
    }
  }
  EXPECT_EQ(refused.size(), orders.size()) << "an order that writes nothing tests nothing";
}

}  // namespace
}  // namespace tessera::server
