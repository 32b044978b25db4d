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

}  // namespace

std::vector<UsageRow> Scheduler::usage(Time now) const {
  FairShare committed = queue_.share();
  for (const auto& [key, job] : jobs_) {
    if (!job.plan) continue;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      for (const Holder& holder : in_flight.holders) {
        committed.charge(job.spec->owner, -holder.expected_seconds, holder.charged);
      }
    }
  }
  return committed.table(now);
}

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
  const auto peers = workers_by_witness_.find(witness_name("", certificate));
  if (certificate.empty() || peers == workers_by_witness_.end()) return jobs;
  for (const WorkerKey key : peers->second) {
    const Worker& worker = workers_.at(key);
    jobs.insert(worker.leased_jobs.begin(), worker.leased_jobs.end());
  }
  return jobs;
}

/// Includes the worker in the counts that its state allows.
void Scheduler::count(Worker& worker) {
  const bool is_present = worker.is_available();
  if (is_present && !worker.is_present) present_.add(worker);
  worker.is_present = is_present;
  if (worker.is_working() && !worker.is_counted) working_.add(worker);
  worker.is_counted = worker.is_working();
  update_idle(worker);
}

/// Call before the tags, threads, host or witness of a worker change.
void Scheduler::uncount(Worker& worker) {
  if (worker.is_present) present_.remove(worker);
  if (worker.is_counted) working_.remove(worker);
  worker.is_present = worker.is_counted = false;
  update_idle(worker);
}

/// Call after the state of a worker has changed.
void Scheduler::recount(Worker& worker) {
  ++step_count_;
  const bool is_present = worker.is_available();
  if (worker.is_present != is_present || worker.is_counted != worker.is_working()) uncount(worker);
  count(worker);
}

/// Call after a worker's credits or units have changed.
void Scheduler::update_idle(Worker& worker) {
  const auto count_tags = [&](std::int32_t change) {
    const auto add = [&](const std::string& tag) {
      std::int32_t& workers = idle_tags_[tag];
      workers += change;
      if (workers == 0) idle_tags_.erase(tag);
    };
    add("");
    for (const std::string& served : worker.serves) add(served);
  };
  const bool is_idle = worker.is_counted && worker.credits > 0;
  if (is_idle && worker.idle_load == worker.load()) return;
  if (worker.idle_load) idle_.erase({*worker.idle_load, worker.key});
  if (worker.idle_load && !is_idle) count_tags(-1);
  if (is_idle && !worker.idle_load) count_tags(1);
  worker.idle_load.reset();
  if (!is_idle) return;
  worker.idle_load = worker.load();
  idle_.emplace(*worker.idle_load, worker.key);
}

WorkerKey Scheduler::connect(const Hello& hello, Time now) {
  advance(now);
  WorkerKey& key = worker_by_id_[hello.worker_id];
  if (key == 0) key = ++last_worker_;
  Worker& worker = workers_[key];
  uncount(worker);
  worker.key = key;
  worker.id = hello.worker_id;
  worker.name = hello.name;
  worker.host = hello.host;
  worker.isa = hello.isa;
  worker.certificate = hello.certificate;
  set_witness(worker, witness_name(hello.worker_id, hello.certificate));
  worker.thread_count = std::max(hello.thread_count, 1);
  worker.tags = {hello.tags.begin(), hello.tags.end()};
  worker.own_pool = hello.pool;
  place(worker);
  worker.connected = true;
  worker.lost = worker.draining = false;
  worker.last_contact = now;
  worker.credits = std::max(hello.credit_count, 0);
  worker.outbox = {};
  effects_.roster.emplace_back(worker.id, true);
  const bool ends_grace = missing_workers_.erase(worker.id) > 0 && missing_workers_.empty();
  recount(worker);
  const bool had_appeared = std::exchange(work_appeared_, false);
  adopt(worker, hello, now);
  if (ends_grace || had_appeared || work_appeared_) {
    work_appeared_ = true;
    dispatch_all(now);
  } else {
    dispatch(worker, now);  // others have had the chance to take what is waiting
  }
  return key;
}

/// Names who answers for the worker. One that shares its witness with a worker that is quarantined
/// is quarantined likewise.
void Scheduler::set_witness(Worker& worker, std::string witness) {
  if (!worker.witness.empty() && worker.witness != witness) forget_witness(worker);
  worker.witness = std::move(witness);
  std::set<WorkerKey>& peers = workers_by_witness_[worker.witness];
  for (const WorkerKey peer : peers) {
    const Worker& other = workers_.at(peer);
    if (!other.quarantined || worker.quarantined) continue;
    worker.quarantined = true;
    worker.quarantined_until = other.quarantined_until;
    if (worker.quarantined_until) timed_quarantines_.insert(worker.key);
    break;
  }
  peers.insert(worker.key);
  if (is_quarantined(worker.id)) {
    worker.quarantined = true;
    worker.quarantined_until.reset();
  }
}

void Scheduler::forget_witness(Worker& worker) {
  const auto peers = workers_by_witness_.find(worker.witness);
  if (peers == workers_by_witness_.end()) return;
  peers->second.erase(worker.key);
  if (!peers->second.empty()) return;
  workers_by_witness_.erase(peers);
  conduct_.erase(worker.witness);
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
  release_unlisted(worker, listed, now);
  const bool has_returned = work_appeared_;
  for (const auto& [key, attempt] : listed) {
    Job& job = jobs_.at(key.first);
    if (worker.leased_units.count(key) > 0 || has_ended(job.state)) continue;
    hold(job, worker, key.second, Holder{worker.key, attempt, now, false, 0});
    if (job.state == JobState::queued) set_state(job, JobState::running, "", now);
    refresh(job);
  }
  work_appeared_ = has_returned;  // a unit that is held is no work for others
}

void Scheduler::release_unlisted(Worker& worker,
                                 const std::map<std::pair<JobKey, Unit>, Attempt>& listed,
                                 Time now) {
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
}

void Scheduler::disconnect(WorkerKey key) {
  Worker* worker = find_worker(key);
  if (worker == nullptr || !worker->connected) return;
  worker->connected = false;
  recount(*worker);
  if (!worker->draining || !worker->leased_units.empty()) return;
  worker->lost = true;  // it drained and holds nothing
  recount(*worker);
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
  advance(now);
  update_idle(*worker);
  if (worker->is_working()) dispatch(*worker, now);
}

void Scheduler::begin_draining(WorkerKey key) {
  Worker* worker = find_worker(key);
  if (worker == nullptr) return;
  worker->draining = true;
  recount(*worker);
}

void Scheduler::return_units(WorkerKey key, const std::vector<UnitName>& units, Time now) {
  Worker* worker = find_worker(key);
  if (worker == nullptr) return;
  advance(now);
  for (const UnitName& name : units) {
    Job* job = find_job(name.job_id);
    if (job != nullptr && job->plan) release(*job, *worker, name.unit);
  }
  dispatch_all(now);
}

void Scheduler::scene_loaded(WorkerKey key, const std::string& job_id, const SceneLoad& load) {
  Worker* worker = find_worker(key);
  Job* job = find_job(job_id);
  if (worker == nullptr || job == nullptr) return;
  if (worker->leased_jobs.count(job->key) == 0) return;
  if (worker->current_job == job->key)
    worker->load_seconds = load.load_seconds + load.build_seconds;
  remember_scene(*worker, job->scene);
  JobCounters& counters = job->counters;
  counters.load_seconds += load.load_seconds;
  counters.build_seconds += load.build_seconds;
  counters.peak_rss_bytes = std::max(counters.peak_rss_bytes, load.peak_rss_bytes);
  ++counters.accelerator_builds;
  counters.accelerator_build_seconds += load.accelerator_build_seconds;
  counters.accelerator_bytes = std::max(counters.accelerator_bytes, load.accelerator_bytes);
}

void Scheduler::remember_scene(Worker& worker, const SceneKey& scene) {
  std::erase(worker.scenes, scene);
  worker.scenes.insert(worker.scenes.begin(), scene);
  workers_by_scene_[scene].insert(worker.key);
  if (worker.scenes.size() <= kMaxScenes) return;
  forget_scene(worker, worker.scenes.back());
  worker.scenes.pop_back();
}

void Scheduler::forget_scene(const Worker& worker, const SceneKey& scene) {
  const auto workers = workers_by_scene_.find(scene);
  if (workers == workers_by_scene_.end()) return;
  workers->second.erase(worker.key);
  if (workers->second.empty()) workers_by_scene_.erase(workers);
}

void Scheduler::hold(Job& job, Worker& worker, const Unit& unit, const Holder& holder) {
  Holder charged = holder;
  const auto& pass = job.plan->passes()[static_cast<std::size_t>(unit.pass)];
  charged.expected_seconds = job.times.median(pass.sample_count).value_or(kUnknownUnitSeconds);
  charged.charged = now_;
  job.plan->hold(unit, charged);
  worker.leased_units.emplace(job.key, unit);
  ++job.holders[worker.key];
  job.ever_leased_to.insert(worker.key);
  worker.leased_jobs.insert(job.key);
  job.leased_seconds += charged.expected_seconds;
  take_limits(job);
  queue_.charge(job.spec->owner, charged.expected_seconds, charged.charged);
  update_idle(worker);
}

void Scheduler::remove_hold(Job& job, const Unit& unit, const Holder& holder) {
  const auto count = job.holders.find(holder.worker);
  if (count != job.holders.end() && --count->second == 0) job.holders.erase(count);
  job.leased_seconds -= holder.expected_seconds;
  give_back_limits(job);
  queue_.charge(job.spec->owner, -holder.expected_seconds, holder.charged);
  Worker* worker = find_worker(holder.worker);
  if (worker == nullptr) return;
  worker->leased_units.erase({job.key, unit});
  update_idle(*worker);
}

bool Scheduler::release(Job& job, Worker& worker, const Unit& unit) {
  const auto holder = job.plan->release(unit, worker.key);
  if (!holder) return release_audit(job, worker, unit);
  remove_hold(job, unit, *holder);
  refresh(job);
  return true;
}

void Scheduler::mark_lost(Worker& worker, Time now) {
  worker.lost = true;
  recount(worker);
  effects_.to_close.push_back(worker.key);
  effects_.roster.emplace_back(worker.id, false);
  const auto leased = worker.leased_units;
  for (const auto& [key, unit] : leased) {
    if (Job* job = find_job(key)) lose_unit(*job, worker, unit, now);
  }
  worker.leased_units.clear();
}

void Scheduler::forget(Worker& worker) {
  uncount(worker);
  forget_witness(worker);
  for (const SceneKey& scene : worker.scenes) forget_scene(worker, scene);
  timed_quarantines_.erase(worker.key);
  worker_by_id_.erase(worker.id);
}

void Scheduler::acknowledge(WorkerKey key, Acknowledgement acknowledgement) {
  Worker* worker = find_worker(key);
  if (worker == nullptr || !worker->connected)
    return;  // without acknowledgement the worker sends again
  worker->outbox.acknowledgements.push_back(std::move(acknowledgement));
  wake(*worker);
}

/// Has the worker's messages sent. A worker that does not read them is disconnected: it lists what
/// it has when it comes back.
void Scheduler::wake(Worker& worker) {
  if (worker.connected && worker.outbox.size() > policy_.max_outbox) {
    worker.outbox = {};
    to_wake_.erase(worker.key);
    effects_.to_close_unread.push_back(worker.key);
    disconnect(worker.key);
    return;
  }
  to_wake_.insert(worker.key);
}

void Scheduler::revoke(Worker& worker, const Job& job, const Unit& unit) {
  Outbox& outbox = worker.outbox;
  (outbox.has_lease(job.spec->id, unit) ? outbox.withdrawn : outbox.revoked)
      .push_back({job.spec->id, unit});
  wake(worker);
}

/// Has the worker return the units of the job that it has not started.
void Scheduler::revoke_units(Worker& worker, const Job& job) {
  for (const auto& [key, unit] : worker.leased_units) {
    if (key == job.key) revoke(worker, job, unit);
  }
}

void Scheduler::tick(Time now, Duration period) {
  advance(now);
  const Duration late = last_tick_ ? now - *last_tick_ - period : Duration(0);
  last_tick_ = now;
  if (late > policy_.timer_slack) {
    // This process was suspended: messages that arrived meanwhile are still unread.
    for (auto& [key, worker] : workers_) worker.last_contact += late;
    grace_ends_ += late;
    return;
  }
  for (auto it = workers_.begin(); it != workers_.end();) {
    Worker& worker = it->second;
    const Duration silence = now - worker.last_contact;
    if (!worker.lost && silence > policy_.worker_timeout) {
      mark_lost(worker, now);
    }
    if (worker.lost && !worker.connected && silence > policy_.forget_after) {
      forget(worker);
      it = workers_.erase(it);
    } else {
      ++it;
    }
  }
  end_timed_quarantines(now);
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
