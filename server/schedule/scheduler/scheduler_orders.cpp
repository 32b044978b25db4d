// Operator commands: drain, ban, allow.
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

void Scheduler::ban(const std::string& worker_id) {
  quarantined_.insert(worker_id);
  for (auto& [key, job] : jobs_) {
    for (auto& [unit, audit] : job.audits) audit.disregard(worker_id);
  }
  Worker* worker = find_worker(worker_id);
  if (worker == nullptr) return;
  worker->quarantined = true;
  workers_with_credits_.erase(worker->key);
  const auto leased = worker->leased_units;
  for (const auto& [key, unit] : leased) {
    Job& job = jobs_.at(key);
    if (release(job, *worker, unit)) revoke(*worker, job, unit);
  }
  count_threads();
  work_appeared_ = true;
}

bool Scheduler::allow(const std::string& worker_id, Time now) {
  const bool was_shut_out = quarantined_.erase(worker_id) > 0;
  Worker* worker = find_worker(worker_id);
  if (worker == nullptr) return was_shut_out;
  worker->quarantined = false;
  worker->disproved_failures = 0;
  if (worker->is_working() && worker->credits > 0) workers_with_credits_.insert(worker->key);
  count_threads();
  work_appeared_ = true;
  dispatch_all(now);
  return true;
}

}  // namespace tessera::server
