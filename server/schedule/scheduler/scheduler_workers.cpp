#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::size_t kMaxListed = 4096;   // leases, and units, adopted from one hello
constexpr std::size_t kMaxScenes = 16;     // remembered per worker
constexpr double kUnknownUnitSeconds = 1;  // fair share's assumption before the first result

std::string describe(const JobSpec& spec, const Unit& unit) {
  return absl::StrCat("job ", spec.id, ", frame ", unit.frame, ", tile ", unit.tile, ", pass ",
                      unit.pass);
}

/// Returns whether a unit failed because of its scene, so that every worker would fail.
bool is_scene_fault(absl::StatusCode code) {
  return code == absl::StatusCode::kInvalidArgument || code == absl::StatusCode::kNotFound ||
         code == absl::StatusCode::kUnimplemented;
}

std::string failure_reason(const JobSpec& spec, const Unit& unit,
                           const std::vector<Failure>& failures) {
  std::string reason = absl::StrCat(describe(spec, unit), " failed ", failures.size(), " times");
  for (const Failure& failure : failures) {
    absl::StrAppend(&reason, "\nworker ", failure.worker_id, ": ", failure.message);
    if (!failure.log_tail.empty()) absl::StrAppend(&reason, "\n", failure.log_tail);
  }
  return reason;
}

}  // namespace

Worker* Scheduler::find_worker(WorkerKey worker) {
  const auto found = workers_.find(worker);
  return found == workers_.end() ? nullptr : &found->second;
}

Worker* Scheduler::find_worker(const std::string& id) {
  const auto found = worker_by_id_.find(id);
  return found == worker_by_id_.end() ? nullptr : find_worker(found->second);
}

std::set<JobKey> Scheduler::leased_jobs(const std::string& certificate) const {
  std::set<JobKey> jobs;
  for (const auto& [key, worker] : workers_) {
    if (worker.certificate != certificate) continue;
    jobs.insert(worker.leased_jobs.begin(), worker.leased_jobs.end());
  }
  return jobs;
}

void Scheduler::count_threads() {
  threads_.clear();
  hosts_.clear();
  const auto count = [this](const Worker& worker, const std::string& tag) {
    threads_[tag] += worker.thread_count;
    hosts_[tag].insert(worker.host);
  };
  for (const auto& [key, worker] : workers_) {
    if (!worker.is_working()) continue;
    count(worker, "");
    for (const std::string& tag : worker.tags) {
      if (!tag.empty()) count(worker, tag);
    }
  }
}

WorkerKey Scheduler::connect(const Hello& hello, Time now) {
  WorkerKey& key = worker_by_id_[hello.worker_id];
  if (key == 0) key = ++last_worker_;
  Worker& worker = workers_[key];
  worker.key = key;
  worker.id = hello.worker_id;
  worker.name = hello.name;
  worker.host = hello.host;
  worker.isa = hello.isa;
  worker.certificate = hello.certificate;
  worker.thread_count = std::max(hello.thread_count, 1);
  worker.tags = {hello.tags.begin(), hello.tags.end()};
  worker.connected = true;
  worker.lost = worker.draining = false;
  worker.quarantined = worker.quarantined || is_quarantined(worker.id);
  worker.last_contact = now;
  worker.credits = std::max(hello.credit_count, 0);
  worker.outbox = {};
  missing_workers_.erase(worker.id);
  effects_.roster.emplace_back(worker.id, true);
  adopt(worker, hello, now);
  count_threads();
  if (worker.is_working() && worker.credits > 0) workers_with_credits_.insert(key);
  work_appeared_ = true;
  dispatch_all(now);
  return key;
}

void Scheduler::adopt(Worker& worker, const Hello& hello, Time now) {
  std::vector<const Lease*>
      leases;  // with valid seals; limited, as a long list would block the lock
  for (const Lease& lease : hello.leases) {
    if (leases.size() == kMaxListed) break;
    if (is_seal_valid(lease, worker.id, identity_.store_key)) leases.push_back(&lease);
  }
  std::map<std::pair<JobKey, Unit>, Attempt> listed;
  const auto list = [&](const UnitName& name) {
    if (listed.size() == kMaxListed) return;  // further results count when they arrive
    const auto found = std::find_if(leases.begin(), leases.end(), [&](const Lease* candidate) {
      return candidate->covers(name.unit) && candidate->job_id == name.job_id;
    });
    Job* job = find_job(name.job_id);
    if (found == leases.end() || job == nullptr || has_ended(job->state)) return;
    const Lease* lease = *found;
    job->open_plan();
    if (!wants(*job, *lease, name.unit) || job->plan->is_committed(name.unit)) return;
    listed.emplace(std::pair(job->key, name.unit), lease->attempt);
  };
  if (hello.store_id == identity_.store_id) {
    for (const UnitName& name : hello.running) list(name);
    for (const UnitName& name : hello.unacknowledged) list(name);
  }
  const auto before = worker.leased_units;
  for (const auto& key : before) {
    if (listed.count(key) > 0) continue;
    Job& job = jobs_.at(key.first);
    const InFlight* in_flight = job.plan->find_in_flight(key.second);
    if (in_flight == nullptr) {  // an audit: another worker has it now, but a result still counts
      release(job, worker, key.second);
      continue;
    }
    const auto& holders = in_flight->holders;
    const bool started = std::any_of(holders.begin(), holders.end(), [&](const Holder& holder) {
      return holder.worker == worker.key && holder.started;
    });
    if (started) {
      lose_unit(job, worker, key.second, now);
    } else {
      release(job, worker, key.second);
    }
  }
  for (const auto& [key, attempt] : listed) {
    Job& job = jobs_.at(key.first);
    if (worker.leased_units.count(key) > 0 || has_ended(job.state)) continue;
    hold(job, worker, key.second, Holder{worker.key, attempt, now, false, 0});
    if (job.state == JobState::queued) set_state(job, JobState::running, "", now);
  }
}

void Scheduler::disconnect(WorkerKey key) {
  Worker* worker = find_worker(key);
  if (worker == nullptr || !worker->connected) return;
  worker->connected = false;
  workers_with_credits_.erase(key);
  count_threads();
  if (!worker->draining || !worker->leased_units.empty()) return;
  worker->lost = true;  // it drained and holds nothing
  effects_.roster.emplace_back(worker->id, false);
}

void Scheduler::record_contact(WorkerKey key, Time now) {
  if (Worker* worker = find_worker(key)) worker->last_contact = now;
}

void Scheduler::heartbeat(WorkerKey key, const std::vector<UnitName>& started,
                          std::int64_t rss_bytes, Time now) {
  Worker* worker = find_worker(key);
  if (worker == nullptr) return;
  worker->rss_bytes = rss_bytes;
  for (const UnitName& name : started) {
    Job* job = find_job(name.job_id);
    InFlight* in_flight =
        job != nullptr && job->plan ? job->plan->find_in_flight(name.unit) : nullptr;
    if (in_flight == nullptr) continue;
    for (Holder& holder : in_flight->holders) {
      if (holder.worker == key && !holder.started) holder.started = now;
    }
  }
}

void Scheduler::grant_credits(WorkerKey key, std::int32_t count, Time now) {
  constexpr std::int32_t kMaxCredits = 1 << 20;  // limits what a faulty worker can claim
  Worker* worker = find_worker(key);
  if (worker == nullptr || count <= 0) return;
  worker->credits = std::min(worker->credits, kMaxCredits) + std::min(count, kMaxCredits);
  if (!worker->is_working()) return;
  workers_with_credits_.insert(key);
  dispatch(*worker, now);
}

void Scheduler::begin_draining(WorkerKey key) {
  Worker* worker = find_worker(key);
  if (worker == nullptr) return;
  worker->draining = true;
  workers_with_credits_.erase(key);
  count_threads();
}

void Scheduler::return_units(WorkerKey key, const std::vector<UnitName>& units, Time now) {
  Worker* worker = find_worker(key);
  if (worker == nullptr) return;
  for (const UnitName& name : units) {
    Job* job = find_job(name.job_id);
    if (job != nullptr && job->plan) release(*job, *worker, name.unit);
  }
  dispatch_all(now);
}

void Scheduler::fail_unit(WorkerKey key, const Lease& lease, std::int32_t tile, Failure failure,
                          absl::StatusCode code, Time now) {
  Worker* worker = find_worker(key);
  Job* job = find_job(lease.job_id);
  if (worker == nullptr || job == nullptr || has_ended(job->state)) return;
  if (!is_seal_valid(lease, worker->id, identity_.store_key)) return;
  const Unit unit{lease.frame, tile, lease.pass};
  job->open_plan();
  if (!wants(*job, lease, unit)) return;
  failure.worker_id = worker->id;
  if (is_scene_fault(code)) {
    fail_job(*job, absl::Status(code, absl::StrCat("bad scene: ", failure.message)), now);
    return;
  }
  if (job->plan->is_committed(unit)) {
    release_audit(*job, *worker, unit);
    disprove(UnitFailures{{std::move(failure)}, 0}, "");
    return;
  }
  release(*job, *worker, unit);
  UnitFailures& failures = job->unit_failures[unit];
  failures.failures.push_back(std::move(failure));
  if (static_cast<std::int32_t>(failures.failures.size()) >= policy_.failure_limit) {
    const std::string reason = failure_reason(*job->spec, unit, failures.failures);
    fail_job(*job, absl::Status(code, reason), now);
    return;
  }
  work_appeared_ = true;
  dispatch_all(now);
}

void Scheduler::disprove(const UnitFailures& failures, const std::string& worker_id) {
  for (const Failure& failure : failures.failures) {
    Worker* worker = find_worker(failure.worker_id);
    if (worker == nullptr || worker->id == worker_id) continue;
    if (++worker->disproved_failures < policy_.disproved_limit || worker->quarantined) continue;
    worker->quarantined = true;
    workers_with_credits_.erase(worker->key);
    count_threads();
    for (const auto& [job, unit] : worker->leased_units) revoke(*worker, jobs_.at(job), unit);
  }
}

void Scheduler::scene_loaded(WorkerKey key, const std::string& job_id, const SceneLoad& load) {
  Worker* worker = find_worker(key);
  Job* job = find_job(job_id);
  if (worker == nullptr || job == nullptr) return;
  if (worker->leased_jobs.count(job->key) == 0) return;
  if (worker->current_job == job->key)
    worker->load_seconds = load.load_seconds + load.build_seconds;
  std::erase(worker->scenes, job->scene);
  worker->scenes.insert(worker->scenes.begin(), job->scene);
  if (worker->scenes.size() > kMaxScenes) worker->scenes.pop_back();
  JobCounters& counters = job->counters;
  counters.load_seconds += load.load_seconds;
  counters.build_seconds += load.build_seconds;
  counters.peak_rss_bytes = std::max(counters.peak_rss_bytes, load.peak_rss_bytes);
  ++counters.accelerator_builds;
  counters.accelerator_build_seconds += load.accelerator_build_seconds;
  counters.accelerator_bytes = std::max(counters.accelerator_bytes, load.accelerator_bytes);
}

void Scheduler::hold(Job& job, Worker& worker, const Unit& unit, const Holder& holder) {
  Holder charged = holder;
  const auto& pass = job.plan->passes()[static_cast<std::size_t>(unit.pass)];
  charged.expected_seconds = job.times.median(pass.sample_count).value_or(kUnknownUnitSeconds);
  job.plan->hold(unit, charged);
  worker.leased_units.emplace(job.key, unit);
  ++job.holders[worker.key];
  job.ever_leased_to.insert(worker.key);
  worker.leased_jobs.insert(job.key);
  job.leased_seconds += charged.expected_seconds;
  charge(job, charged.expected_seconds);
}

void Scheduler::remove_hold(Job& job, const Unit& unit, const Holder& holder) {
  const auto count = job.holders.find(holder.worker);
  if (count != job.holders.end() && --count->second == 0) job.holders.erase(count);
  job.leased_seconds -= holder.expected_seconds;
  charge(job, -holder.expected_seconds);
  if (Worker* worker = find_worker(holder.worker)) worker->leased_units.erase({job.key, unit});
}

bool Scheduler::release(Job& job, Worker& worker, const Unit& unit) {
  const auto holder = job.plan->release(unit, worker.key);
  if (!holder) return release_audit(job, worker, unit);
  remove_hold(job, unit, *holder);
  refresh(job);
  return true;
}

void Scheduler::lose_unit(Job& job, Worker& worker, const Unit& unit, Time now) {
  if (!release(job, worker, unit) || has_ended(job.state)) return;
  UnitFailures& failures = job.unit_failures[unit];
  if (++failures.losses <= policy_.loss_limit) return;
  fail_job(
      job,
      absl::UnavailableError(absl::StrCat(describe(*job.spec, unit), " was lost with its worker ",
                                          failures.losses, " times; the last was ", worker.id)),
      now);
}

void Scheduler::mark_lost(Worker& worker, Time now) {
  worker.lost = true;
  workers_with_credits_.erase(worker.key);
  effects_.to_close.push_back(worker.key);
  effects_.roster.emplace_back(worker.id, false);
  const auto leased = worker.leased_units;
  for (const auto& [key, unit] : leased) {
    if (Job* job = find_job(key)) lose_unit(*job, worker, unit, now);
  }
  worker.leased_units.clear();
}

void Scheduler::acknowledge(WorkerKey key, Acknowledgement acknowledgement) {
  Worker* worker = find_worker(key);
  if (worker == nullptr || !worker->connected)
    return;  // without acknowledgement the worker sends again
  worker->outbox.acknowledgements.push_back(std::move(acknowledgement));
  wake(*worker);
}

void Scheduler::revoke(Worker& worker, const Job& job, const Unit& unit) {
  worker.outbox.revoked.push_back({job.spec->id, unit});
  wake(worker);
}

void Scheduler::tick(Time now, Duration period) {
  const Duration late = last_tick_ ? now - *last_tick_ - period : Duration(0);
  last_tick_ = now;
  if (late > policy_.timer_slack) {
    // This process was suspended: messages that arrived meanwhile are still unread.
    for (auto& [key, worker] : workers_) worker.last_contact += late;
    grace_ends_ += late;
    return;
  }
  bool lost_some = false;
  for (auto it = workers_.begin(); it != workers_.end();) {
    Worker& worker = it->second;
    const Duration silence = now - worker.last_contact;
    if (!worker.lost && silence > policy_.worker_timeout) {
      mark_lost(worker, now);
      lost_some = true;
    }
    if (worker.lost && !worker.connected && silence > policy_.forget_after) {
      worker_by_id_.erase(worker.id);
      it = workers_.erase(it);
    } else {
      ++it;
    }
  }
  if (lost_some) count_threads();
  if (!missing_workers_.empty() && now >= grace_ends_) {
    for (const std::string& id : missing_workers_) effects_.roster.emplace_back(id, false);
    missing_workers_.clear();
  }
  fail_unresolvable_audits(now);
  work_appeared_ = true;
  dispatch_all(now);
  balance_tail(now);
}

}  // namespace tessera::server
