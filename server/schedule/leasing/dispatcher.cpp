#include "server/schedule/leasing/dispatcher.h"

#include <algorithm>
#include <utility>

namespace tessera::server {

using contract::Unit;

void Dispatcher::dispatch(Worker& worker, Time now) {
  while (has_work() && dispatch_one(worker, now)) {
  }
}

void Dispatcher::dispatch_all(Time now) {
  if (!ready_.has_new_work() || (absences_.is_grace(now))) return;
  ready_.set_new_work(false);
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
  ready_.set_new_work(false);
}

std::int32_t Dispatcher::run_length(const Job& job, const Worker& worker) const {
  const std::int64_t threads = counts_.working().threads(job.requirement);
  const std::int64_t waiting = job.plan->counts().waiting;
  const std::int64_t open = waiting + job.plan->counts().in_flight;
  const std::int64_t length = std::max<std::int64_t>(waiting / (2 * threads), 1);
  // Near the end no worker gets more than its share of the rest, so that others do not idle.
  const std::int64_t share = (open * worker.thread_count + threads - 1) / threads;
  const auto leased = job.holders.find(worker.key);
  const std::int64_t room = share - (leased == job.holders.end() ? 0 : leased->second);
  return static_cast<std::int32_t>(
      std::min({static_cast<std::int64_t>(worker.credits), length, room,
                ready_.limited().limits().room(job.spec->limits)}));
}

bool Dispatcher::lease_run(Job& job, Worker& worker, Time now) {
  job.open_plan();
  const std::int32_t max_tiles = run_length(job, worker);
  if (max_tiles <= 0) return false;
  const auto run = job.plan->next_run(
      max_tiles, [&](const Unit& unit) { return choice_.may_take(worker, job, unit); });
  if (!run) return false;
  if (ready_.is_queued(job.key)) ready_.queue().note_leased(ReadyJobs::key_of(job), ready_.now());
  grants_.lease(job, worker, *run, now);
  return true;
}

/// Returns whether a worker with credits could be leased something.
bool Dispatcher::has_work() const {
  if (counts_.idle().empty()) return false;
  if (!ready_.full().empty() || ready_.queue().has_any(counts_.idle_tags()) ||
      ready_.limited().has_work(counts_.idle_tags()))
    return true;
  const auto& by_tag = audit_table_.waiting().by_tag();
  return std::any_of(by_tag.begin(), by_tag.end(),
                     [this](const auto& tag) { return counts_.idle_tags().count(tag.first) > 0; });
}

bool Dispatcher::dispatch_one(Worker& worker, Time now) {
  counts_.note_step();
  if (absences_.is_grace(now)) return false;
  if (!worker.is_working() || worker.credits <= 0) return false;
  if (lease_audit(worker)) return true;  // frames wait for audits
  std::set<JobKey> refused;
  while (const JobKey key = choice_.choose_job(worker, refused)) {
    if (lease_run(jobs_.at(key), worker, now)) return true;
    refused.insert(key);
  }
  return false;
}

/// Returns workers with credits: least loaded first, among equals those with the scene of a queued
/// job first.
std::vector<Worker*> Dispatcher::workers_by_load_and_scene() {
  const auto has_queued_scene = [this](const Worker* worker) {
    return std::any_of(worker->scenes.begin(), worker->scenes.end(),
                       [this](const SceneKey& scene) { return ready_.queue().has_scene(scene); });
  };
  std::vector<Worker*> workers;
  workers.reserve(counts_.idle().size());
  std::size_t first = 0;  // of those with the same load
  for (auto it = counts_.idle().begin(); it != counts_.idle().end();) {
    const double load = it->first;
    for (; it != counts_.idle().end() && it->first == load; ++it) {
      workers.push_back(&workers_.at(it->second));
      counts_.note_step();
    }
    std::stable_partition(workers.begin() + static_cast<std::ptrdiff_t>(first), workers.end(),
                          has_queued_scene);
    first = workers.size();
  }
  return workers;
}

bool Dispatcher::lease_audit(Worker& worker) {
  if (audit_table_.waiting().empty()) return false;
  return std::any_of(worker.serves.begin(), worker.serves.end(), [&](const std::string& tag) {
    const AuditQueue::Groups* groups = audit_table_.waiting().find(tag);
    return groups != nullptr && lease_audit_of(*groups, worker);
  });
}

bool Dispatcher::lease_audit_of(const AuditQueue::Groups& groups, Worker& worker) {
  for (const auto& [committer, keys] : groups) {
    for (const auto& [key, unit] : keys) {
      counts_.note_step();
      Job& job = jobs_.at(key);
      Audit& audit = job.audits.at(unit);
      if (ready_.limited().limits().room(job.spec->limits) == 0 || is_barred(worker, job)) continue;
      if (witnesses_.may_audit(worker, job, audit)) {
        grants_.lease_audit(job, unit, worker);
        return true;
      }
      // A group of undisputed audits has one committer and one tag: the answer is the same for all.
      if (!committer.empty()) break;
    }
  }
  return false;
}

}  // namespace tessera::server
