#include "tests/unit/server/simulation/simulated_server.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "tests/support/disk/disk_model.h"
#include "tests/unit/server/simulation/simulated_streams.h"
#include "tests/unit/server/simulation/small_jobs.h"

namespace tessera::server {
namespace {

using testing::DiskEvent;
using testing::DiskImage;
using testing::DiskModel;

constexpr int kWorkers = 3, kChaosSteps = 250, kCalmSteps = 4000, kSettlingSteps = 200;
constexpr Duration kLongestStep = std::chrono::milliseconds(450);
constexpr std::int64_t kSmallIngestBytes = 20'000, kSmallFilmBytes = 100'000;
constexpr std::size_t kMaxOutbox = 10;  // more than a worker is leased when it connects
constexpr int kMaxUnfinishedJobs = 3;   // of an owner
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
    : dice_(seed),
      is_shared_(dice_.one_in(4)),
      is_audited_(!is_shared_ && dice_.one_in(2)),
      now_(Time{} + std::chrono::hours(100)),
      network_(dice_) {
  for (int i = 0; i < kWorkers + (is_audited_ ? 1 : 0); ++i) {
    computers_.emplace_back().id = absl::StrCat("w", i);
    computers_.back().is_faulty = i == kWorkers;
    computers_.back().threads = is_shared_ ? 1 : 1 + dice_.below(3);
    computers_.back().credits = computers_.back().threads + (is_shared_ ? 1 : dice_.below(5));
  }
  ingest_bytes_ = dice_.one_in(2) ? kSmallIngestBytes : std::int64_t{1} << 28;
  film_bytes_ = dice_.one_in(2) ? kSmallFilmBytes : std::int64_t{1} << 30;
  policy_.audit_fraction = is_audited_ ? 1 : 0;
  policy_.loss_limit = 1000;
  policy_.max_outbox = kMaxOutbox;
  policy_.share.half_life = std::chrono::minutes(10);
  policy_.share.max_wait = std::chrono::seconds(20);
  policy_.share.weights = {{small_job(kFirstSharedKind, 8).owner, kFirstWeight}};
  FairnessChecks::Workers workers;
  for (const Computer& computer : computers_) {
    ++workers.count;
    workers.credit_count += computer.credits;
    // Each unit takes up to 2.1 s; four steps until the worker has its next units.
    const int rounds = (computer.credits + computer.threads - 1) / computer.threads;
    workers.longest_turn = std::max<Duration>(
        workers.longest_turn, rounds * std::chrono::milliseconds(2100 + 450) + 4 * kLongestStep);
  }
  fairness_ = std::make_unique<FairnessChecks>(policy_, workers, kUnitSeconds);
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
  options.policy = policy_;
  options.ingest_bytes = ingest_bytes_;
  options.film_memory_bytes = film_bytes_;
  options.client_quotas.defaults.jobs = kMaxUnfinishedJobs;
  options.clock = [this] { return now_; };
  options.wall_us = store_options.now_us;
  options.random = [this] { return dice_.next(); };
  options.read_spec = [](const JobRecord& record) { return small_job(record); };
  options.log = [this](LogLevel, const std::string& message) { trace(message); };
  options.write_request = [](const JobSpec& spec) { return request_of(spec); };
  auto coordinator = Coordinator::open(*store_, std::move(options));
  if (!coordinator.ok()) return coordinator.status();
  coordinator_ = *std::move(coordinator);
  fairness_->note_start(now_);
  allowed_jobs_.clear();
  check_committed();
  return absl::OkStatus();
}

void SimulatedServer::stop() {
  network_.clear();
  for (const auto& upload : uploads_) upload->is_ended = true;
  for (Computer& computer : computers_) {
    if (computer.link != nullptr) computer.link->is_ended = computer.link->is_broken = true;
    if (computer.upload != nullptr) computer.upload->is_ended = true;
  }
  links_.clear();
  uploads_.clear();
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
    job.stray_count = 0;
    ++job.request;
  }
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

/// The server ends: answers that were given up to this disk operation arrive.
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

/// Sends the answers that were given in this step.
void SimulatedServer::send_answers() {
  for (Answer& each : std::exchange(answers_, {})) network_.send(now_, std::move(each.arrive));
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

/// Lets time and the disk do something unusual.
void SimulatedServer::disturb() {
  if (dice_.one_in(100)) {
    now_ += std::chrono::seconds(dice_.below(20));
    fairness_->note_late_timer(now_);
  }
  if (dice_.one_in(is_shared_ ? 200 : 40)) {
    disk_->set_full(true);
    trace("the disk is full");
    ++events_.full_disks;
  }
}

void SimulatedServer::step(bool is_calm) {
  now_ += std::chrono::milliseconds(50) + dice_.below(400) * std::chrono::milliseconds(1);
  if (!is_calm) disturb();
  if (is_calm || dice_.one_in(10)) {
    events_.refused_writes += disk_->refused_count();
    disk_->set_full(false);
    if (!is_calm) trace("the disk has space");
  }
  send_outboxes(is_calm);
  network_.deliver(now_);
  read_uploads();
  for (Computer& computer : computers_) act_as_worker(computer, is_calm);
  if (!is_calm) act_as_client();
  const int first_operation = operation();
  work_of_server(is_calm);
  if (!is_calm && dice_.one_in(is_shared_ ? 150 : 25)) {
    crash(first_operation);
  } else {
    send_answers();
  }
  if (violation_.empty()) check();
}

void SimulatedServer::check() {
  for (const int kind : uploaded_) {
    if (!store_->assets().has(scene_of(kind))) violate(absl::StrCat("scene ", kind, " is lost"));
  }
  for (auto& [request_id, job] : jobs_) check_job(job);
  check_memory();
  const FarmView farm(coordinator_->farm());
  if (const absl::Status status = farm.scheduler().verify(); !status.ok()) {
    violate(std::string(status.message()));
  }
  if (const std::string unfair = fairness_->check(farm, now_); !unfair.empty()) violate(unfair);
}

/// Compares what the server keeps in memory with its limits.
void SimulatedServer::check_memory() {
  const Coordinator::MemoryUse use = coordinator_->memory_use();
  // Each stream may have taken one block more; a block is kept as bytes and decoded.
  std::set<const Upload*> uploads;
  for (const auto& upload : uploads_) uploads.insert(upload.get());
  for (const Computer& computer : computers_) uploads.insert(computer.upload.get());
  const auto streams = static_cast<std::int64_t>(uploads.size());
  if (use.ingest_bytes > ingest_bytes_ + streams * 2 * largest_block_) {
    violate(absl::StrCat(use.ingest_bytes, " bytes of blocks wait, of at most ", ingest_bytes_));
  }
  if (use.film_bytes > film_bytes_) {
    violate(absl::StrCat(use.film_bytes, " bytes of films, of at most ", film_bytes_));
  }
  if (use.connections > computers_.size()) violate("a worker has two connections");
  const FarmView farm(coordinator_->farm());
  const Scheduler& scheduler = farm.scheduler();
  if (scheduler.workers().all().size() > computers_.size()) violate("a worker is listed twice");
  for (const auto& [key, worker] : scheduler.workers().all()) {
    if (worker.outbox.size() > policy_.max_outbox) violate(worker.id + " has too many messages");
  }
  if (scheduler.jobs().all().size() > jobs_.size()) violate("there are more jobs than requests");
  std::map<std::string, int> unfinished;
  for (const auto& [key, job] : scheduler.jobs().all()) {
    if (!has_ended(job.state)) ++unfinished[job.spec->owner];
  }
  for (const auto& [owner, count] : unfinished) {
    int& allowed = allowed_jobs_.try_emplace(owner, count).first->second;
    if (count > std::max(allowed, kMaxUnfinishedJobs)) {
      violate(absl::StrCat(owner, " has ", count, " unfinished jobs"));
    }
    allowed = std::min(allowed, count);
  }
}

/// After a start, what was acknowledged as committed must be so.
void SimulatedServer::check_committed() {
  if (is_audited_) return;
  const FarmView farm(coordinator_->farm());
  for (const auto& [request_id, client_job] : jobs_) {
    const Job* job = farm.find_job(client_job.id);
    const auto committed = committed_.find(client_job.id);
    if (job == nullptr || committed == committed_.end() || client_job.is_extended) continue;
    if (has_ended(job->state)) continue;
    for (const auto& [unit, attempt] : committed->second) {
      if (job->plan && job->plan->is_committed(unit)) continue;
      violate(absl::StrCat("unit (", unit.frame, ", ", unit.tile, ", ", unit.pass, ") of job ",
                           job->spec->id, " was acknowledged and is lost"));
    }
  }
}

/// Returns whether nothing is under way, in memory or at a worker.
bool SimulatedServer::is_settled() {
  const Coordinator::MemoryUse use = coordinator_->memory_use();
  const FarmView farm(coordinator_->farm());
  const auto& workers = farm.scheduler().workers().all();
  return use.ingest_bytes == 0 && use.film_bytes == 0 && use.blocks == 0 && use.writes == 0 &&
         use.film_tasks == 0 &&
         std::all_of(workers.begin(), workers.end(),
                     [](const auto& entry) {
                       const Worker& worker = entry.second;
                       return worker.leased_units.empty() && worker.leased_jobs.empty();
                     }) &&
         std::all_of(computers_.begin(), computers_.end(),
                     [](const Computer& computer) { return computer.held.empty(); });
}

std::string SimulatedServer::run() {
  for (int i = 0; i < kChaosSteps && violation_.empty(); ++i) step(false);
  network_.calm_down();
  fairness_->note_calm(now_);
  for (int i = 0; i < kCalmSteps && violation_.empty() && !is_over(); ++i) {
    finish_requests();
    step(true);
  }
  // A request that nobody awaits any more, such as a removal, may still arrive.
  for (int i = 0; i < kSettlingSteps && violation_.empty() && !(is_over() && is_settled()); ++i) {
    finish_requests();
    step(true);
  }
  if (violation_.empty()) violation_ = check_end();
  return violation_;
}

/// Returns why the jobs are not done at the end.
std::string SimulatedServer::why_not_over() {
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

std::string SimulatedServer::check_end() {
  for (const auto& [worker, silence] : coordinator_->workers().list()) {
    events_.quarantines += worker.quarantined ? 1 : 0;
  }
  events_.lost_messages = network_.events().lost;
  events_.overtaken_messages = network_.events().overtaken;
  events_.leases = fairness_->events().leases;
  events_.overdue_leases = fairness_->events().overdue_leases;
  events_.share_windows = fairness_->events().share_windows;
  if (!is_over()) return why_not_over();
  if (!is_settled()) {
    const Coordinator::MemoryUse use = coordinator_->memory_use();
    return absl::StrCat("at the end ", use.ingest_bytes, " bytes of blocks, ", use.film_bytes,
                        " bytes of films, ", use.blocks, " blocks, ", use.writes, " writes and ",
                        use.film_tasks, " film tasks are left, or a worker holds units");
  }
  for (auto& [request_id, job] : jobs_) {
    if (job.is_gone) continue;
    if (std::string wrong = check_done(job); !wrong.empty()) return wrong;
  }
  return "";
}

}  // namespace tessera::server
