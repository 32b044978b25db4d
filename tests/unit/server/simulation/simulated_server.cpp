#include "tests/unit/server/simulation/simulated_server.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "tests/support/disk/disk_model.h"
#include "tests/unit/server/simulation/small_jobs.h"

namespace tessera::server {
namespace {

using testing::DiskEvent;
using testing::DiskImage;
using testing::DiskModel;

constexpr int kWorkers = 3, kChaosSteps = 250, kCalmSteps = 4000;
constexpr std::int64_t kDayUs = std::int64_t{86'400} * 1'000'000;

/// A disk whose contents are durable.
DiskModel disk_of(const DiskImage& image) {
  DiskModel disk;
  for (const auto& [path, contents] : image) {
    if (path.empty()) continue;
    if (!contents) {
      disk.apply({DiskEvent::Kind::make_folder, path, "", 0, ""});
    } else {
      disk.apply({DiskEvent::Kind::create, path, "", 0, ""});
      disk.apply({DiskEvent::Kind::write, path, "", 0, *contents});
      disk.apply({DiskEvent::Kind::sync_file, path, "", 0, ""});
    }
  }
  disk.apply({DiskEvent::Kind::sync_folder, "", "", 0, ""});
  for (const auto& [path, contents] : image) {
    if (!contents) disk.apply({DiskEvent::Kind::sync_folder, path, "", 0, ""});
  }
  return disk;
}

}  // namespace

SimulatedServer::SimulatedServer(std::uint64_t seed)
    : dice_(seed), now_(Time{} + std::chrono::hours(100)), is_audited_(dice_.one_in(2)) {
  for (int i = 0; i < kWorkers + (is_audited_ ? 1 : 0); ++i) {
    computers_.emplace_back().id = absl::StrCat("w", i);
    computers_.back().is_faulty = i == kWorkers;
    computers_.back().threads = 1 + dice_.below(3);
    computers_.back().credits = computers_.back().threads + dice_.below(5);
  }
  if (const absl::Status started = start(); !started.ok()) violate(started.ToString());
}

SimulatedServer::~SimulatedServer() {
  stop();
}

void SimulatedServer::violate(const std::string& what) {
  if (violation_.empty()) violation_ = what;
}

void SimulatedServer::trace(const std::string& what) const {
  static const bool is_on = std::getenv("TESSERA_TRACE") != nullptr;
  if (is_on)
    std::printf("%.2f s: %s\n", seconds(now_ - (Time{} + std::chrono::hours(100))), what.c_str());
}

// Server ------------------------------------------------------------------------------------------

absl::Status SimulatedServer::start() {
  disk_ = std::make_unique<testing::PowerCutDisk>(folder_.path());
  StoreOptions store_options;
  store_options.checkpoint_pages = 20 + dice_.below(100);
  store_options.segment_bytes = 20'000;
  store_options.ballast_bytes = 1 << 16;
  store_options.now_us = [this] { return 1'700'000'000'000'000 + wall_offset_us_; };
  store_options.warn = [](const std::string&) {};
  uses_rows_ = dice_.one_in(2);
  if (!uses_rows_) {
    store_options.row_block_bytes = store_options.row_image_bytes = 0;
    store_options.row_asset_bytes = 0;
  }
  auto store = Store::open(folder_.path() + "/store", *disk_, store_options);
  if (!store.ok()) return store.status();
  store_ = *std::move(store);
  FarmOptions options;
  options.policy.audit_fraction = is_audited_ ? 1 : 0;
  options.policy.loss_limit = 1000;
  options.clock = [this] { return now_; };
  options.wall_us = store_options.now_us;
  options.random = [this] { return dice_.next(); };
  options.read_spec = [](const JobRecord& record) { return small_job(record); };
  options.log = [this](LogLevel, const std::string& message) { trace(message); };
  options.write_request = [](const JobSpec& spec) { return request_of(spec); };
  auto coordinator = Coordinator::open(*store_, std::move(options));
  if (!coordinator.ok()) return coordinator.status();
  coordinator_ = *std::move(coordinator);
  return absl::OkStatus();
}

void SimulatedServer::stop() {
  coordinator_.reset();
  store_.reset();
  answers_.clear();  // the coordinator refused what was under way
  disk_.reset();
}

/// Ends the server between two of its last disk operations, from `first_operation` on, and starts
/// another one on what is left on the disk.
void SimulatedServer::crash(int first_operation) {
  const bool is_killed = dice_.one_in(3);
  const int last =
      is_killed ? operation() : first_operation + dice_.below(operation() - first_operation + 1);
  ++(is_killed ? events_.crashes : events_.power_cuts);
  DiskModel disk = disk_of(at_start_);
  for (int i = 0; i < last; ++i) disk.apply(disk_->events()[static_cast<std::size_t>(i)]);
  trace(absl::StrCat(is_killed ? "killed" : "power cut", " after operation ", last, " of ",
                     operation(), ", the last step began at ", first_operation));
  arrive_until(is_killed && dice_.one_in(2) ? first_operation : last);
  events_.lost_answers += static_cast<int>(answers_.size());
  stop();
  for (auto& [request_id, job] : jobs_) {
    if (job.is_pending) job.must_be.reset();
    if (job.is_uncertain) job.is_done = false;
    job.is_pending = false;
  }
  for (Computer& computer : computers_) computer.is_connected = false;
  at_start_ = is_killed         ? disk.visible()
              : dice_.one_in(3) ? disk.synced()
                                : disk.torn(dice_.next());
  testing::restore_image(at_start_, folder_.path());
  now_ += std::chrono::milliseconds(dice_.below(20'000));
  if (dice_.one_in(4)) wall_offset_us_ += (dice_.below(60) - 30) * kDayUs;
  if (const absl::Status started = start(); !started.ok()) {
    violate(absl::StrCat("no start: ", started.ToString()));
  }
}

/// Answers that were given up to this disk operation arrive.
void SimulatedServer::arrive_until(int operation) {
  std::vector<Answer> given;
  std::swap(given, answers_);
  for (const Answer& each : given) {
    if (each.operation <= operation) {
      each.arrive();
    } else {
      answers_.push_back(each);
    }
  }
}

void SimulatedServer::work_of_server(bool is_calm) {
  coordinator_->tick();
  const int rounds = is_calm ? 1000 : dice_.below(4);
  for (int i = 0; i < rounds; ++i) {
    const bool wrote = coordinator_->run_writer(false);
    const bool answered = (is_calm || dice_.one_in(2)) && coordinator_->run_answers(false);
    const bool merged = (is_calm || dice_.one_in(2)) && coordinator_->run_film(false);
    if (is_calm && !wrote && !answered && !merged) return;
  }
}

// Steps -------------------------------------------------------------------------------------------

void SimulatedServer::step(bool is_calm) {
  now_ += std::chrono::milliseconds(50 + dice_.below(400));
  if (!is_calm && dice_.one_in(100)) now_ += std::chrono::seconds(dice_.below(20));
  if (!is_calm && dice_.one_in(40)) {
    disk_->set_full(true);
    trace("the disk is full");
    ++events_.full_disks;
  }
  if (is_calm || dice_.one_in(10)) {
    events_.refused_writes += disk_->refused_count();
    disk_->set_full(false);
    if (!is_calm) trace("the disk has space");
  }
  for (Computer& computer : computers_) act_as_worker(computer, is_calm);
  if (!is_calm) act_as_client();
  const int first_operation = operation();
  work_of_server(is_calm);
  if (!is_calm && dice_.one_in(25)) {
    crash(first_operation);
  } else {
    arrive_until(operation());
  }
  if (violation_.empty()) check();
}

void SimulatedServer::check() {
  for (const int kind : uploaded_) {
    if (!store_->assets().has(scene_of(kind))) violate(absl::StrCat("scene ", kind, " is lost"));
  }
  for (auto& [request_id, job] : jobs_) check_job(job);
}

std::string SimulatedServer::run() {
  for (int i = 0; i < kChaosSteps && violation_.empty(); ++i) step(false);
  for (int i = 0; i < kCalmSteps && violation_.empty() && !is_over(); ++i) {
    finish_requests();
    step(true);
  }
  if (violation_.empty()) violation_ = check_end();
  return violation_;
}

std::string SimulatedServer::check_end() {
  for (const auto& [worker, silence] : coordinator_->workers().list()) {
    events_.quarantines += worker.quarantined ? 1 : 0;
  }
  if (!is_over()) {
    for (auto& [request_id, job] : jobs_) {
      const auto view = coordinator_->queries().job(job.id);
      if (!view.ok() || view->state == JobState::done) continue;
      return absl::StrCat("job ", job.id, " is ", state_name(view->state),
                          " at the end: ", view->reason, ", ", view->committed_unit_count, " of ",
                          view->unit_count, " units");
    }
    for (const auto& [request_id, job] : jobs_) {
      if (!job.is_gone && (job.id.empty() || job.is_pending)) {
        return absl::StrCat(request_id, " for job ", job.id, " has no answer at the end");
      }
    }
    return "a job is gone at the end";
  }
  for (auto& [request_id, job] : jobs_) {
    if (job.is_gone) continue;
    if (std::string wrong = check_done(job); !wrong.empty()) return wrong;
  }
  return "";
}

}  // namespace tessera::server
