// Operator commands: drain, ban, allow, move, set aside, bring back.
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

bool Scheduler::drain(const std::string& worker_id) {
  Worker* worker = find_worker(worker_id);
  if (worker == nullptr || !worker->connected) return false;
  worker->outbox.drain = true;
  wake(*worker);
  begin_draining(worker->key);
  return true;
}

bool Scheduler::is_quarantined(const std::string& worker_id) const {
  if (quarantined_.count(worker_id) > 0) return true;
  const auto key = worker_by_id_.find(worker_id);
  return key != worker_by_id_.end() && quarantined_.count(workers_.at(key->second).witness) > 0;
}

std::string Scheduler::witness_of(const std::string& worker_id) const {
  const auto key = worker_by_id_.find(worker_id);
  return key == worker_by_id_.end() ? worker_id : workers_.at(key->second).witness;
}

std::vector<std::string> Scheduler::names_to_ban(const std::string& worker_id) const {
  std::vector<std::string> names{worker_id};
  const std::string witness = witness_of(worker_id);
  if (witness != worker_id) names.push_back(witness);
  return names;
}

/// Marks the worker quarantined and releases its units to others.
void Scheduler::exclude(Worker& worker) {
  worker.quarantined = true;
  worker.quarantined_until.reset();
  timed_quarantines_.erase(worker.key);
  recount(worker);
  const auto leased = worker.leased_units;
  for (const auto& [key, unit] : leased) {
    Job& job = jobs_.at(key);
    if (release(job, worker, unit)) revoke(worker, job, unit);
  }
}

void Scheduler::ban(const std::string& name) {
  const std::string witness = witness_of(name);
  quarantined_.insert({name, witness});
  for (auto& [key, job] : jobs_) {
    for (auto& [unit, audit] : job.audits) audit.disregard(witness);
  }
  const auto peers = workers_by_witness_.find(witness);
  if (peers == workers_by_witness_.end()) return;
  for (const WorkerKey key : peers->second) exclude(workers_.at(key));
  work_appeared_ = true;
}

bool Scheduler::allow(const std::string& worker_id, Time now) {
  advance(now);
  bool is_known = false;
  for (const std::string& name : names_to_ban(worker_id)) {
    is_known = quarantined_.erase(name) > 0 || is_known;
  }
  const std::string witness = witness_of(worker_id);
  conduct_.erase(witness);
  const auto peers = workers_by_witness_.find(witness);
  if (peers == workers_by_witness_.end()) return is_known;
  for (const WorkerKey key : peers->second) {
    Worker& worker = workers_.at(key);
    worker.quarantined = quarantined_.count(worker.id) > 0;  // its own ban may remain
    worker.quarantined_until.reset();
    timed_quarantines_.erase(key);
    recount(worker);
  }
  work_appeared_ = true;
  dispatch_all(now);
  return true;
}

/// Determines where a worker that is not counted belongs: its pool, and so which jobs it may be
/// leased; whether it is set aside.
void Scheduler::place(Worker& worker) {
  worker.pool = placement_.pool_of(worker.id, worker.own_pool);
  worker.serves = {requirement(worker.pool, "")};
  for (const std::string& tag : worker.tags) worker.serves.insert(requirement(worker.pool, tag));
  const auto aside = placement_.aside().find(worker.id);
  worker.set_aside = aside != placement_.aside().end();
  worker.note = worker.set_aside ? aside->second : "";
}

/// Call after placement_ has changed.
void Scheduler::place_again(Worker& worker, Time now) {
  uncount(worker);
  place(worker);
  recount(worker);
  for (const auto& [key, unit] : worker.leased_units) {
    const Job& job = jobs_.at(key);
    if (worker.set_aside || worker.serves.count(job.requirement) == 0) revoke(worker, job, unit);
  }
  work_appeared_ = true;
  dispatch_all(now);
}

void Scheduler::move(const std::string& worker_id, const std::string& pool, Time now) {
  advance(now);
  placement_.move(worker_id, pool);
  if (Worker* worker = find_worker(worker_id)) place_again(*worker, now);
}

void Scheduler::set_aside(const std::string& worker_id, const std::string& reason, Time now) {
  advance(now);
  placement_.set_aside(worker_id, reason);
  if (Worker* worker = find_worker(worker_id)) place_again(*worker, now);
}

void Scheduler::bring_back(const std::string& worker_id, Time now) {
  advance(now);
  placement_.bring_back(worker_id);
  if (Worker* worker = find_worker(worker_id)) place_again(*worker, now);
}

}  // namespace tessera::server
