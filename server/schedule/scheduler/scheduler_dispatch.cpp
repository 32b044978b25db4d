#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

using contract::Unit;

bool Scheduler::may_work_for(const Worker& worker, const Job& job) const {
  const JobSpec& spec = *job.spec;
  if (worker.serves.count(job.requirement) == 0 || limits().room(spec.limits) == 0) return false;
  if (spec.blocked_workers.count(worker.id) > 0) return false;
  return spec.max_workers == 0 || job.holders.count(worker.key) > 0 ||
         static_cast<std::int32_t>(job.holders.size()) < spec.max_workers;
}

bool Scheduler::may_take(const Worker& worker, const Job& job, const Unit& unit) const {
  if (job.unit_failures.empty() && job.scene_faults.empty()) return true;
  const Names failed = failed_witnesses(job, unit);
  // It failed on this worker: others go first, if there are any.
  return failed.count(worker.witness) == 0 || !has_others(job, failed);
}

/// Returns whether this worker is known to have the files of the job's scene.
bool Scheduler::has_scene(const Worker& worker, const Job& job) {
  return std::find(worker.scenes.begin(), worker.scenes.end(), job.scene) != worker.scenes.end();
}

/// Returns whether a worker renders the job, or has credits and its scene.
bool Scheduler::has_enough_workers(const Job& job) const {
  if (!job.holders.empty()) return true;
  const auto workers = workers_by_scene_.find(job.scene);
  return workers != workers_by_scene_.end() &&
         std::any_of(workers->second.begin(), workers->second.end(), [&](WorkerKey key) {
           const Worker& worker = workers_.at(key);
           return worker.idle_load && may_work_for(worker, job);
         });
}

/// Returns whether the job is leased before the other one, in the order of JobQueue::next().
bool Scheduler::precedes(const Job& job, const Job& other) const {
  const auto use = [this](const Job& of) { return queue_.share().position(of.spec->owner); };
  if (job.spec->priority != other.spec->priority) return job.spec->priority > other.spec->priority;
  const double used = use(job), other_used = use(other);
  return std::tie(used, job.spec->owner, job.key) <
         std::tie(other_used, other.spec->owner, other.key);
}

/// Returns the first of the jobs that have their maximum of workers, this one among them; 0 if
/// there is none.
JobKey Scheduler::next_full_job(const Worker& worker,
                                const std::function<bool(JobKey)>& may) const {
  if (full_.empty()) return 0;
  constexpr auto kMax = std::numeric_limits<std::int32_t>::max();
  const Job* best = nullptr;
  const auto& units = worker.leased_units;
  for (auto it = units.begin(); it != units.end();
       it = units.upper_bound({it->first, {kMax, kMax, kMax}})) {
    const Job& job = jobs_.at(it->first);
    if (full_.count(job.key) == 0 || job.holders.count(worker.key) == 0 || !may(job.key)) continue;
    if (best == nullptr || precedes(job, *best)) best = &job;
  }
  return best == nullptr ? 0 : best->key;
}

/// Returns the next job of the queue or, if another worker serves that one, a job of the same owner
/// and priority whose scene this worker has.
JobKey Scheduler::next_job(const Worker& worker, const std::function<bool(JobKey)>& may) {
  Names open;  // a worker's own set suffices while no limit is in use
  const Names& queues =
      limited_.empty() ? worker.serves : (open = limited_.open_parts(worker.serves));
  const JobQueue::Seeker seeker{queues, may};
  const JobKey next = queue_.next(seeker, now_);
  const JobKey full = next_full_job(worker, may);
  if (next == 0) return full;
  const Job& job = jobs_.at(next);
  if (full != 0 && !queue_.is_overdue(queue_key(job), now_) && precedes(jobs_.at(full), job)) {
    return full;
  }
  if (worker.scenes.empty() || has_scene(worker, job) || !has_enough_workers(job)) return next;
  JobKey nearest = 0;
  for (const SceneKey& scene : worker.scenes) {
    const JobKey found = queue_.oldest({job.spec->priority, job.spec->owner, scene}, seeker);
    if (found != 0 && (nearest == 0 || found < nearest)) nearest = found;
  }
  return nearest == 0 ? next : nearest;
}

JobKey Scheduler::choose_job(const Worker& worker, const std::set<JobKey>& refused) {
  const std::function<bool(JobKey)> may = [&](JobKey key) {
    ++step_count_;
    return refused.count(key) == 0 && may_work_for(worker, jobs_.at(key));
  };
  const bool has_waiting =
      queued_.count(worker.current_job) > 0 || full_.count(worker.current_job) > 0;
  const Job* current =
      has_waiting && may(worker.current_job) ? find_job(worker.current_job) : nullptr;
  if (current == nullptr) return next_job(worker, may);
  const bool has_paid_off =
      worker.load_seconds && worker.seconds_in_job >= policy_.load_factor * *worker.load_seconds;
  Names open;  // a worker's own set suffices while no limit is in use
  const Names& queues =
      limited_.empty() ? worker.serves : (open = limited_.open_parts(worker.serves));
  const JobQueue::Seeker seeker{queues, may};
  if (!has_paid_off && !queue_.has_above(current->spec->priority, seeker, now_)) {
    return current->key;
  }
  const JobKey next = next_job(worker, may);
  if (next == 0) return current->key;
  const JobSpec& chosen = *jobs_.at(next).spec;
  const bool equal =
      chosen.priority == current->spec->priority && chosen.owner == current->spec->owner;
  return equal ? current->key : next;  // the worker has its scene
}

std::int32_t Scheduler::run_length(const Job& job, const Worker& worker) const {
  const std::int64_t threads = working_.threads(job.requirement);
  const std::int64_t waiting = job.plan->waiting_count();
  const std::int64_t open = waiting + job.plan->in_flight_count();
  const std::int64_t length = std::max<std::int64_t>(waiting / (2 * threads), 1);
  // Near the end no worker gets more than its share of the rest, so that others do not idle.
  const std::int64_t share = (open * worker.thread_count + threads - 1) / threads;
  const auto leased = job.holders.find(worker.key);
  const std::int64_t room = share - (leased == job.holders.end() ? 0 : leased->second);
  return static_cast<std::int32_t>(std::min(
      {static_cast<std::int64_t>(worker.credits), length, room, limits().room(job.spec->limits)}));
}

Lease Scheduler::make_lease(const Job& job, const Worker& worker, const Run& run) {
  const contract::Pass& pass = job.plan->passes()[static_cast<std::size_t>(run.pass)];
  Lease lease{job.spec->id,
              run.frame,
              run.pass,
              run.first_tile,
              run.tile_count,
              pass.first_sample,
              pass.sample_count,
              {identity_.boot, ++last_attempt_},
              {}};
  lease.seal = make_seal(lease, worker.id, identity_.store_key);
  return lease;
}

void Scheduler::send_lease(Worker& worker, const Lease& lease) {
  worker.credits -= lease.tile_count;
  update_idle(worker);
  worker.outbox.leases.push_back(lease);
  wake(worker);
}

void Scheduler::lease(Job& job, Worker& worker, const Run& run, Time now) {
  const Lease lease = make_lease(job, worker, run);
  for (std::int32_t i = 0; i < run.tile_count; ++i) {
    const Unit unit{run.frame, run.first_tile + i, run.pass};
    hold(job, worker, unit, Holder{worker.key, lease.attempt, std::nullopt, false, 0, now});
    if (job.unit_failures.count(unit) > 0) ++job.counters.retried;
  }
  if (worker.current_job != job.key) {
    worker.current_job = job.key;
    worker.seconds_in_job = 0;
    worker.load_seconds.reset();
  }
  if (job.state == JobState::queued) set_state(job, JobState::running, "", now);
  if (!job.running_since) job.running_since = now;
  send_lease(worker, lease);
  refresh(job);
}

bool Scheduler::lease_run(Job& job, Worker& worker, Time now) {
  job.open_plan();
  const std::int32_t max_tiles = run_length(job, worker);
  if (max_tiles <= 0) return false;
  const auto run =
      job.plan->next_run(max_tiles, [&](const Unit& unit) { return may_take(worker, job, unit); });
  if (!run) return false;
  if (queued_.count(job.key) > 0) queue_.note_leased(queue_key(job), now_);
  lease(job, worker, *run, now);
  return true;
}

/// Returns whether a worker with credits could be leased something.
bool Scheduler::has_work() const {
  if (idle_.empty()) return false;
  if (!full_.empty() || queue_.has_any(idle_tags_) || limited_.has_work(idle_tags_)) return true;
  const auto& by_tag = waiting_audits_.by_tag();
  return std::any_of(by_tag.begin(), by_tag.end(),
                     [this](const auto& tag) { return idle_tags_.count(tag.first) > 0; });
}

bool Scheduler::dispatch_one(Worker& worker, Time now) {
  ++step_count_;
  if (!missing_workers_.empty() && now < grace_ends_) return false;
  if (!worker.is_working() || worker.credits <= 0) return false;
  if (lease_audit(worker)) return true;  // frames wait for audits
  std::set<JobKey> refused;
  while (const JobKey key = choose_job(worker, refused)) {
    if (lease_run(jobs_.at(key), worker, now)) return true;
    refused.insert(key);
  }
  return false;
}

void Scheduler::dispatch(Worker& worker, Time now) {
  while (has_work() && dispatch_one(worker, now)) {
  }
}

/// Returns workers with credits: least loaded first, among equals those with the scene of a queued
/// job first.
std::vector<Worker*> Scheduler::workers_by_load_and_scene() {
  const auto has_queued_scene = [this](const Worker* worker) {
    return std::any_of(worker->scenes.begin(), worker->scenes.end(),
                       [this](const SceneKey& scene) { return queue_.has_scene(scene); });
  };
  std::vector<Worker*> workers;
  workers.reserve(idle_.size());
  std::size_t first = 0;  // of those with the same load
  for (auto it = idle_.begin(); it != idle_.end();) {
    const double load = it->first;
    for (; it != idle_.end() && it->first == load; ++it) {
      workers.push_back(&workers_.at(it->second));
      ++step_count_;
    }
    std::stable_partition(workers.begin() + static_cast<std::ptrdiff_t>(first), workers.end(),
                          has_queued_scene);
    first = workers.size();
  }
  return workers;
}

void Scheduler::dispatch_all(Time now) {
  if (!work_appeared_ || (!missing_workers_.empty() && now < grace_ends_)) return;
  work_appeared_ = false;
  if (!has_work()) return;
  std::vector<Worker*> waiting = workers_by_load_and_scene();
  // In rounds, so that a small job is spread over the farm.
  while (!waiting.empty()) {
    std::vector<Worker*> served;
    for (Worker* worker : waiting) {
      if (!has_work()) break;
      if (dispatch_one(*worker, now)) served.push_back(worker);
    }
    waiting = std::move(served);
  }
  work_appeared_ = false;
}

std::vector<Worker*> Scheduler::idle_workers() {
  std::vector<Worker*> idle;
  for (const auto& [load, key] : idle_) {
    if (load >= 1) break;  // they have a unit for each thread
    idle.push_back(&workers_.at(key));
  }
  return idle;
}

void Scheduler::balance_tail(Time now) {
  if (idle_.empty() || tail_.empty() || !missing_workers_.empty()) return;
  std::vector<Worker*> idle = idle_workers();
  if (idle.empty()) return;
  copy_slow_units(idle, now);
  std::int32_t wanted = 0;
  for (const Worker* worker : idle) {
    wanted += std::min(worker->credits, worker->thread_count -
                                            static_cast<std::int32_t>(worker->leased_units.size()));
  }
  if (wanted > 0) steal_unstarted(wanted);
}

void Scheduler::copy_slow_units(std::vector<Worker*>& idle, Time now) {
  for (const JobKey key : tail_) {
    Job& job = jobs_.at(key);
    std::vector<Unit> slow;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      const Holder& holder = in_flight.holders.front();
      if (in_flight.copied || in_flight.holders.size() > 1 || !holder.started) continue;
      const auto& pass = job.plan->passes()[static_cast<std::size_t>(unit.pass)];
      const auto median = job.times.median(pass.sample_count);
      if (median && seconds(now - *holder.started) > 2 * *median) slow.push_back(unit);
    }
    for (const Unit& unit : slow) {
      const auto taker = std::find_if(idle.begin(), idle.end(), [&](const Worker* worker) {
        const WorkerKey holder = job.plan->find_in_flight(unit)->holders.front().worker;
        return worker->key != holder && worker->credits > 0 && may_work_for(*worker, job) &&
               may_take(*worker, job, unit) &&
               static_cast<std::int32_t>(worker->leased_units.size()) < worker->thread_count;
      });
      if (taker == idle.end()) continue;
      lease(job, **taker, Run{unit.frame, unit.pass, unit.tile, 1}, now);
      job.plan->find_in_flight(unit)->copied = true;
    }
  }
}

/// Has workers give back units that they have not begun, for idle ones; each keeps one per thread,
/// whatever jobs its units belong to.
void Scheduler::steal_unstarted(std::int32_t wanted) {
  std::map<WorkerKey, std::int32_t> surplus;
  for (const JobKey key : tail_) {
    const Job& job = jobs_.at(key);
    for (const auto& [holder, count] : job.holders) {
      const Worker& worker = workers_.at(holder);
      surplus.try_emplace(
          holder, static_cast<std::int32_t>(worker.leased_units.size()) - worker.thread_count);
    }
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      if (!in_flight.holders.front().revoking) continue;  // it is being given back
      --wanted;
      --surplus[in_flight.holders.front().worker];
    }
  }
  for (const JobKey key : tail_) {
    Job& job = jobs_.at(key);
    std::vector<Unit> units;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) units.push_back(unit);
    for (auto unit = units.rbegin(); unit != units.rend() && wanted > 0; ++unit) {
      InFlight& in_flight = *job.plan->find_in_flight(*unit);
      Holder& holder = in_flight.holders.front();
      if (in_flight.holders.size() > 1 || holder.started || holder.revoking) continue;
      if (surplus[holder.worker] <= 0) continue;
      --surplus[holder.worker];
      --wanted;
      holder.revoking = true;
      revoke(workers_.at(holder.worker), job, *unit);
    }
  }
}

}  // namespace tessera::server
