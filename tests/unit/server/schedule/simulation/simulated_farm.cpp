#include "tests/unit/server/schedule/simulation/simulated_farm.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/schedule/simulation/simulated_farm_parts.h"

namespace tessera::server {
namespace {

using contract::Unit;
using namespace std::chrono_literals;

constexpr std::chrono::milliseconds kStep{500};
constexpr int kOwners = 4, kChaosSteps = 500;
// Enough for 12 jobs of 3 frames of 60 tiles in 2 passes, each unit audited, one after the other
// because of a limit, 3.2 s of work and up to 1.5 s until it is durable.
constexpr int kCalmSteps = 12 * 3 * 60 * 2 * 2 * 10;

contract::Digest digest_of(const UnitName& name, bool is_lie) {
  return contract::sha256(absl::StrCat(name.job_id, " ", name.unit.frame, " ", name.unit.tile, " ",
                                       name.unit.pass, is_lie ? " wrong" : ""));
}

}  // namespace

std::uint64_t Dice::next() {
  std::uint64_t x = state_ += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
  return x ^ (x >> 31);
}

SimulatedFarm::SimulatedFarm(std::uint64_t seed) : dice_(seed), now_(Time{} + 100h) {
  constexpr double kFractions[] = {0, 0.05, 0.5};
  policy_.audit_fraction = kFractions[dice_.below(3)];
  policy_.loss_limit = 1000;
  policy_.audit_timeout = 1h;
  policy_.share.half_life = 10min;
  policy_.share.weights = {{"owner0", 2.0}};
  limit_ = 2 + dice_.below(4);
  start_scheduler();
  for (const char* certificate : {"anchor1", "anchor2", "anchor3", "anchor4"}) {
    add_computer(certificate, false, true);
  }
  add_job();
}

SimulatedFarm::~SimulatedFarm() = default;

void SimulatedFarm::violate(const std::string& what) {
  if (violation_.empty()) violation_ = absl::StrCat(seconds(now_ - (Time{} + 100h)), " s: ", what);
}

void SimulatedFarm::start_scheduler() {
  const std::vector<std::string> roster(roster_.begin(), roster_.end());
  scheduler_ =
      std::make_unique<Scheduler>(StoreIdentity{"store", "key", ++boot_}, policy_, roster, now_);
  scheduler_->limits().restore_usage(usage_, now_);
  scheduler_->limits().set_limit(kLimit, limit_, now_);
  excess_ = 0;
  for (const auto& [worker, pool] : moved_) scheduler_->orders().move(worker, pool, now_);
  for (const std::string& worker : aside_) scheduler_->orders().set_aside(worker, "", now_);
  scheduler_->limits().stop_accounts(stopped_, now_);
  for (const std::string& name : bans_) scheduler_->quarantine().ban(name);
  for (const auto& [key, stored] : store_) {
    Job& job = scheduler_->changes().add_job(key, stored->spec, stored->state);
    for (const Dependency& dependency : stored->spec->after) {
      const auto removed = removed_.find(dependency.job_id);
      if (removed != removed_.end())
        scheduler_->lifecycle().note_removed(removed->first, removed->second);
    }
    if (stored->units.empty() && stored->frames.empty()) continue;
    for (const std::int32_t frame : stored->frames) scheduler_->results().restore_frame(job, frame);
    for (const auto& [unit, kept] : stored->units) {
      scheduler_->results().restore_unit(job, unit, kept.worker_id, 1);
      if (kept.has_audit) scheduler_->audits().open_audit(job, unit, kept.worker_id, kept.digest);
    }
    finish_frames(job);
  }
  apply_effects();
}

/// The server dies: what is not durable is gone, and all streams break.
void SimulatedFarm::restart_server() {
  ++events_.restarts;
  events_.lost_writes += static_cast<int>(writes_.size());
  writes_.clear();
  usage_ = scheduler_->limits().usage(now_);
  now_ += std::chrono::milliseconds(dice_.below(4000));
  for (auto& [id, computer] : computers_) computer->is_connected = false;
  start_scheduler();
}

void SimulatedFarm::add_job() {
  auto spec = std::make_shared<JobSpec>();
  const JobKey key = ++last_job_;
  spec->id = absl::StrCat("j", key);
  spec->owner = absl::StrCat("owner", dice_.below(kOwners));
  spec->priority = dice_.one_in(4) ? dice_.below(5) - 2 : 0;
  spec->max_workers = dice_.one_in(4) ? 1 + dice_.below(3) : 0;
  spec->required_tag = kTags[dice_.below(3)];
  spec->assets = {{"scene.glb", contract::sha256(std::to_string(dice_.below(4))), 0}};
  spec->settings.width = 8 * (1 + dice_.below(dice_.one_in(5) ? 60 : 8));
  spec->settings.height = 8;
  spec->settings.tile = 8;
  spec->settings.spp = dice_.one_in(2) ? 8 : 64;
  spec->settings.frames = {{0, dice_.below(3), 1}};
  spec->pool = kPools[dice_.one_in(4) ? 1 : 0];
  if (dice_.one_in(4)) spec->limits = {{kLimit, 1 + dice_.below(2)}};
  if (dice_.one_in(2)) add_dependencies(*spec);
  store_[key] = std::make_unique<Stored>();
  store_[key]->spec = spec;
  scheduler_->changes().add_job(key, spec, JobState::queued);
  scheduler_->dispatcher().dispatch_all(now_);
}

SimulatedFarm::Computer& SimulatedFarm::add_computer(const std::string& certificate, bool is_faulty,
                                                     bool is_anchor) {
  auto computer = std::make_unique<Computer>();
  computer->id = absl::StrCat("w", ++last_computer_);
  computer->certificate = certificate;
  computer->is_faulty = is_faulty;
  computer->is_anchor = is_anchor;
  computer->pool = kPools[is_anchor ? last_computer_ % 2 : dice_.below(2)];
  computer->threads = 1 + dice_.below(4);
  computer->credits = computer->threads + dice_.below(4);
  for (const char* tag : {"a", "b"}) {
    if (is_anchor || dice_.one_in(2)) computer->tags.insert(tag);
  }
  Computer& added = *computer;
  computers_[added.id] = std::move(computer);
  connect(added);
  return added;
}

void SimulatedFarm::connect(Computer& computer) {
  Hello hello;
  hello.worker_id = hello.name = computer.id;
  hello.host = absl::StrCat("host ", computer.certificate);
  hello.certificate = computer.certificate;
  hello.thread_count = computer.threads;
  hello.tags = {computer.tags.begin(), computer.tags.end()};
  hello.pool = computer.pool;
  hello.store_id = "store";
  for (Task& task : computer.tasks) {
    hello.leases.push_back(task.lease);
    (task.is_delivered ? hello.unacknowledged : hello.running).push_back(task.name);
    task.is_delivered = false;  // it is sent again
  }
  const auto held = static_cast<std::int32_t>(computer.tasks.size());
  hello.credit_count = std::max(computer.credits - held, 0);
  computer.key = scheduler_->connections().connect(hello, now_);
  excess_ = std::max(excess_, scheduler_->limits().table().all().at(kLimit).used);
  computer.is_connected = true;
}

void SimulatedFarm::lose_stream(Computer& computer) {
  if (computer.is_connected) scheduler_->connections().disconnect(computer.key);
  computer.is_connected = false;
}

// Workers -----------------------------------------------------------------------------------------

void SimulatedFarm::read_mail(Computer& computer) {
  Worker* worker = scheduler_->workers().find(computer.key);
  if (worker == nullptr) return;
  const Outbox mail = std::exchange(worker->outbox, Outbox{});
  std::int32_t credits = 0;
  for (const Acknowledgement& told : mail.acknowledgements) {
    credits += static_cast<std::int32_t>(
        std::erase_if(computer.tasks, [&](const Task& task) { return task.name == told.unit; }));
  }
  scheduler_->connections().grant_credits(computer.key, credits, now_);
  return_revoked(computer, mail.revoked);
  for (const Lease& lease : mail.leases) take_lease(computer, lease);
  return_revoked(computer, mail.withdrawn);
}

void SimulatedFarm::take_lease(Computer& computer, const Lease& lease) {
  last_lease_ = std::max(last_lease_, lease.attempt);
  const Job* job = scheduler_->jobs().find(lease.job_id);
  if (job != nullptr && !has_ended(job->state)) check_lease(computer, *job, lease);
  for (std::int32_t i = 0; i < lease.tile_count; ++i) {
    const Unit unit{lease.frame, lease.first_tile + i, lease.pass};
    if (job != nullptr && job->plan && job->plan->is_committed(unit) &&
        job->audits.count(unit) == 0 && store_.at(job->key)->units.count(unit) > 0) {
      const Worker& worker = *scheduler_->workers().find(computer.key);
      if (worker.leased_units.count({job->key, unit}) > 0) violate("a committed unit is leased");
    }
    computer.tasks.push_back({{lease.job_id, unit}, lease});
  }
}

/// Gives back units that were revoked before they began.
void SimulatedFarm::return_revoked(Computer& computer, const std::vector<UnitName>& revoked) {
  std::vector<UnitName> returned;
  for (const UnitName& name : revoked) {
    const auto task = std::find_if(computer.tasks.begin(), computer.tasks.end(),
                                   [&](const Task& held) { return held.name == name; });
    if (task == computer.tasks.end() || task->is_delivered) continue;
    const Job* job = scheduler_->jobs().find(name.job_id);
    if (task->ready && job != nullptr && !has_ended(job->state)) continue;
    computer.tasks.erase(task);
    returned.push_back(name);
  }
  if (returned.empty()) return;
  scheduler_->connections().return_units(computer.key, returned, now_);
  scheduler_->connections().grant_credits(computer.key, static_cast<std::int32_t>(returned.size()),
                                          now_);
}

void SimulatedFarm::work(Computer& computer, bool is_calm) {
  if (!computer.is_up) return;
  if (!computer.is_connected) {
    if (is_calm || computer.is_anchor || dice_.one_in(3)) connect(computer);
    return;
  }
  scheduler_->connections().record_contact(computer.key, now_);
  if (is_calm || !dice_.one_in(4)) read_mail(computer);
  std::int32_t running = 0;
  std::vector<UnitName> started;
  for (Task& task : computer.tasks) {
    if (task.is_delivered) continue;
    if (!task.ready && running < computer.threads) {
      task.ready = now_ + std::chrono::milliseconds(200 + dice_.below(3000));
      started.push_back(task.name);
    }
    running += task.ready ? 1 : 0;
  }
  scheduler_->connections().heartbeat(computer.key, started, 0, now_);
  for (std::size_t i = 0; i < computer.tasks.size(); ++i) {
    Task& task = computer.tasks[i];
    if (!task.ready || *task.ready > now_ || task.is_delivered) continue;
    if (!is_calm && dice_.one_in(10)) continue;  // it delivers late
    finish(computer, task, is_calm);
  }
  std::erase_if(computer.tasks, [](const Task& task) { return task.name.job_id.empty(); });
}

void SimulatedFarm::finish(Computer& computer, Task& task, bool is_calm) {
  if (computer.is_faulty && !is_calm && dice_.one_in(3)) {
    constexpr absl::StatusCode kCodes[] = {absl::StatusCode::kInternal, absl::StatusCode::kDataLoss,
                                           absl::StatusCode::kInvalidArgument};
    ++events_.failures;
    const int reports = 1 + dice_.below(3);
    for (int i = 0; i < reports; ++i) {
      scheduler_->failures().fail_unit(computer.key, task.lease, task.name.unit.tile,
                                       {"", "junk", ""}, kCodes[dice_.below(3)], now_);
    }
    scheduler_->connections().grant_credits(computer.key, 1, now_);
    task.name.job_id.clear();
    return;
  }
  const bool is_lie = computer.is_faulty && !is_calm && dice_.one_in(4);
  events_.lies += is_lie ? 1 : 0;
  task.digest = digest_of(task.name, is_lie);
  task.is_delivered = true;
  const Task copy = task;
  deliver(computer.id, copy);
  if (!is_calm && dice_.one_in(15)) deliver(computer.id, copy);
}

// Server ------------------------------------------------------------------------------------------

void SimulatedFarm::acknowledge(const std::string& worker_id, const UnitName& name,
                                AckStatus status) {
  const Worker* worker = scheduler_->workers().find(worker_id);
  if (worker != nullptr) scheduler_->connections().acknowledge(worker->key, {name, status, ""});
}

/// Returns whether the unit is committed; its result then answers an audit or is superfluous.
bool SimulatedFarm::answer_duplicate(Job& job, const Write& write) {
  const auto stored = store_.at(job.key)->units.find(write.name.unit);
  if (stored == store_.at(job.key)->units.end()) return false;
  const StoredUnit kept = stored->second;
  ++events_.duplicates;
  scheduler_->audits().answer_audit(job, write.name.unit, write.lease,
                                    {write.worker_id, write.digest}, {kept.worker_id, kept.digest},
                                    now_);
  scheduler_->results().release_duplicate(job, write.name.unit, write.worker_id);
  acknowledge(write.worker_id, write.name, AckStatus::duplicate);
  return true;
}

void SimulatedFarm::deliver(const std::string& worker_id, const Task& task) {
  Write write{worker_id, task.name, task.lease, task.digest, false, now_};
  Job* job = scheduler_->jobs().find(task.name.job_id);
  if (job != nullptr && !has_ended(job->state)) job->open_plan();
  if (job == nullptr || !scheduler_->results().wants(*job, task.lease, task.name.unit) ||
      scheduler_->quarantine().is_quarantined(worker_id)) {
    if (job != nullptr && job->plan) {
      scheduler_->results().release_duplicate(*job, task.name.unit, worker_id);
    }
    acknowledge(worker_id, task.name, AckStatus::obsolete);
  } else if (!answer_duplicate(*job, write)) {
    write.has_audit = scheduler_->audits().wants_audit(*job, task.name.unit, worker_id, now_);
    write.durable = now_ + std::chrono::milliseconds(dice_.below(1500));
    writes_.push_back(write);
  }
}

/// A block is durable.
void SimulatedFarm::commit(const Write& write) {
  Job* job = scheduler_->jobs().find(write.name.job_id);
  if (job == nullptr) return acknowledge(write.worker_id, write.name, AckStatus::obsolete);
  if (!scheduler_->results().wants(*job, write.lease, write.name.unit)) {
    return acknowledge(write.worker_id, write.name, AckStatus::obsolete);
  }
  if (answer_duplicate(*job, write)) return;
  ++events_.commits;
  store_.at(job->key)->units[write.name.unit] = {write.worker_id, write.digest, write.has_audit};
  scheduler_->results().commit(*job, write.name.unit, write.worker_id, 1);
  if (scheduler_->quarantine().is_quarantined(write.worker_id)) {
    redo_units(write.worker_id);
  } else if (write.has_audit) {
    scheduler_->audits().open_audit(*job, write.name.unit, write.worker_id, write.digest);
  }
  acknowledge(write.worker_id, write.name, AckStatus::committed);
  finish_frames(*job);
}

void SimulatedFarm::run_disk() {
  std::vector<Write> durable;
  for (const Write& write : writes_) {
    if (write.durable <= now_) durable.push_back(write);
  }
  std::erase_if(writes_, [&](const Write& write) { return write.durable <= now_; });
  for (const Write& write : durable) commit(write);
}

void SimulatedFarm::finish_frames(Job& job) {
  if (has_ended(job.state) || !job.plan) return;
  for (const std::int32_t frame : job.plan->shape().frames) {
    if (job.plan->is_finished(frame) || !job.plan->is_complete(frame)) continue;
    if (scheduler_->audits().has_audits(job, frame)) continue;
    Stored& stored = *store_.at(job.key);
    std::erase_if(stored.units, [&](const auto& unit) { return unit.first.frame == frame; });
    stored.frames.insert(frame);
    scheduler_->results().finish_frame(job, frame, now_);
    if (has_ended(job.state)) return;
  }
}

/// Drops what a faulty worker committed of unfinished frames.
void SimulatedFarm::redo_units(const std::string& worker_id) {
  for (auto& [key, stored] : store_) {
    Job* job = scheduler_->jobs().find(key);
    if (job == nullptr || has_ended(job->state)) continue;
    std::vector<Unit> bad;
    for (const auto& [unit, kept] : stored->units) {
      if (kept.worker_id == worker_id) bad.push_back(unit);
    }
    for (const Unit& unit : bad) {
      ++events_.redone;
      stored->units.erase(unit);
      scheduler_->results().redo(*job, unit);
    }
  }
  scheduler_->dispatcher().dispatch_all(now_);
}

void SimulatedFarm::apply_effects() {
  for (int round = 0; round < 10; ++round) {
    const Effects effects = scheduler_->take_effects();
    for (const auto& [id, joined] : effects.roster) {
      if (joined) {
        roster_.insert(id);
      } else {
        roster_.erase(id);
      }
    }
    for (const WorkerKey key : effects.to_close) {
      scheduler_->connections().disconnect(key);
      for (auto& [id, computer] : computers_) {
        if (computer->key == key) computer->is_connected = false;
      }
    }
    for (const JobKey key : effects.changed) {
      const Job* job = scheduler_->jobs().find(key);
      if (job != nullptr) store_.at(key)->state = job->state;
    }
    for (const UnitName& name : effects.audited) {
      ++events_.audits;
      Job* job = scheduler_->jobs().find(name.job_id);
      if (job == nullptr) continue;
      auto& units = store_.at(job->key)->units;
      if (const auto unit = units.find(name.unit); unit != units.end()) {
        unit->second.has_audit = false;
      }
      finish_frames(*job);
    }
    for (const std::string& id : effects.faulty_workers) {
      ++events_.quarantines;
      const auto computer = computers_.find(id);
      if (computer != computers_.end() && !computer->second->is_faulty) {
        violate(absl::StrCat("honest worker ", id, " is quarantined"));
      }
      for (const std::string& name : scheduler_->quarantine().names_to_ban(id)) bans_.insert(name);
      redo_units(id);
    }
    if (effects.changed.empty() && effects.audited.empty() && effects.faulty_workers.empty()) {
      return;
    }
  }
}

void SimulatedFarm::step(bool is_calm) {
  now_ += kStep;
  if (!is_calm && dice_.one_in(60)) {  // the process or its clock stands still
    ++events_.late_ticks;
    now_ += std::chrono::milliseconds(2000 + dice_.below(20'000));
  }
  scheduler_->tick(now_, kStep);
  apply_effects();
  if (!is_calm) disturb();
  apply_effects();
  for (auto& [id, computer] : computers_) {
    work(*computer, is_calm);
    apply_effects();
  }
  run_disk();
  apply_effects();
  check();
}

// Checks ------------------------------------------------------------------------------------------

void SimulatedFarm::check() {
  if (const absl::Status status = scheduler_->verify(); !status.ok()) {
    violate(std::string(status.message()));
  }
  check_limits();
  for (const auto& [key, job] : scheduler_->jobs().all()) {
    if (job.state == JobState::failed && !scheduler_->dependencies().check_possible(job).ok())
      continue;
    if (job.state == JobState::failed || job.is_paused_by_failures()) {
      violate(absl::StrCat("job failed: ", job.reason));
    }
    if (job.state == JobState::failed || !job.plan) continue;
    for (const auto& [unit, kept] : store_.at(key)->units) {
      if (!has_ended(job.state) && !job.plan->is_committed(unit)) {
        violate(absl::StrCat("a unit of job ", job.spec->id, " is lost"));
      }
    }
  }
  if (scheduler_->limits().usage(now_).size() > kOwners)
    violate("use of more owners than there are");
}

std::string SimulatedFarm::check_end() {
  for (const auto& [key, job] : scheduler_->jobs().all()) {
    if (job.state == JobState::done) continue;
    return absl::StrCat("job ", job.spec->id, " is ", state_name(job.state),
                        " at the end: ", scheduler_->waiting().wait_text(job));
  }
  for (const auto& [key, worker] : scheduler_->workers().all()) {
    if (!worker.leased_units.empty()) return absl::StrCat(worker.id, " holds units at the end");
  }
  return "";
}

std::string SimulatedFarm::run() {
  for (int i = 0; i < kChaosSteps && violation_.empty(); ++i) step(false);
  resume_all();
  const auto is_over = [this] {
    return std::all_of(scheduler_->jobs().all().begin(), scheduler_->jobs().all().end(),
                       [](const auto& entry) { return has_ended(entry.second.state); });
  };
  for (int i = 0; i < kCalmSteps && violation_.empty() && !is_over(); ++i) step(true);
  if (violation_.empty()) violation_ = check_end();
  return violation_;
}

}  // namespace tessera::server
