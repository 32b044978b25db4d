#include "server/schedule/trust/quarantine.h"

#include <utility>

namespace tessera::server {

using contract::Unit;

bool Quarantine::is_quarantined(const std::string& worker_id) const {
  if (quarantined_.count(worker_id) > 0) return true;
  const Worker* worker = workers_.find(worker_id);
  return worker != nullptr && quarantined_.count(worker->witness) > 0;
}

std::vector<std::string> Quarantine::names_to_ban(const std::string& worker_id) const {
  std::vector<std::string> names{worker_id};
  const std::string witness = workers_.witness_of(worker_id);
  if (witness != worker_id) names.push_back(witness);
  return names;
}

void Quarantine::ban(const std::string& name) {
  const std::string witness = workers_.witness_of(name);
  quarantined_.insert({name, witness});
  for (const JobKey key : audits_.audited_jobs()) {
    for (auto& [unit, audit] : jobs_.at(key).audits) audit.disregard(witness);
  }
  const std::set<WorkerKey>& peers = workers_.of_witness(witness);
  if (peers.empty()) return;
  for (const WorkerKey key : peers) exclude(workers_.at(key));
  ready_.note_work();
}

void Quarantine::note_failing(Worker& worker, Job& job, Time now) {
  Conduct& conduct = conduct_[worker.witness];
  conduct.failing_jobs.insert(job.key);
  job.failed_by.insert(worker.witness);
  if (static_cast<std::int32_t>(conduct.failing_jobs.size()) < policy_.failing_job_limit) return;
  if (counts_.working().has_witness_beyond("", {worker.witness})) {
    quarantine_witness(worker.witness, now + policy_.quarantine_time);
  }
}

void Quarantine::forgive(Job& job) {
  for (const std::string& witness : std::exchange(job.failed_by, {})) {
    const auto conduct = conduct_.find(witness);
    if (conduct == conduct_.end()) continue;
    conduct->second.failing_jobs.erase(job.key);
    const auto count = static_cast<std::int32_t>(conduct->second.failing_jobs.size());
    if (count < policy_.failing_job_limit) end_quarantine(witness);
  }
  job.scene_faults.clear();
}

void Quarantine::disprove(const std::set<std::string>& failed, const std::string& witness) {
  for (const std::string& name : failed) {
    if (name == witness || !workers_.has_witness(name)) continue;
    if (++conduct_[name].disproved >= policy_.disproved_limit)
      quarantine_witness(name, std::nullopt);
  }
}

void Quarantine::disprove_failures(Job& job, const Unit& unit, const std::string& witness) {
  if (job.unit_failures.empty() && job.scene_faults.empty()) return;
  std::set<std::string> failed;
  if (const auto failures = job.unit_failures.find(unit); failures != job.unit_failures.end()) {
    failed = witnesses_of(failures->second.failures);
    job.unit_failures.erase(failures);
  }
  if (const auto faults = job.scene_faults.find(unit.frame); faults != job.scene_faults.end()) {
    failed.merge(witnesses_of(faults->second));
    job.scene_faults.erase(faults);
  }
  disprove(failed, witness);
}

void Quarantine::end_timed_quarantines(Time now) {
  const std::set<WorkerKey> keys = timed_quarantines_;
  for (const WorkerKey key : keys) {
    const Worker& worker = workers_.at(key);
    if (!worker.quarantined_until || *worker.quarantined_until > now) continue;
    const std::string witness = worker.witness;
    conduct_[witness].failing_jobs.clear();
    end_quarantine(witness);
  }
}

/// Marks the worker quarantined and releases its units to others.
void Quarantine::exclude(Worker& worker) {
  worker.quarantined = true;
  worker.quarantined_until.reset();
  timed_quarantines_.erase(worker.key);
  counts_.recount(worker);
  const auto leased = worker.leased_units;
  for (const auto& [key, unit] : leased) {
    Job& job = jobs_.at(key);
    if (leases_.release(job, worker, unit)) outgoing_.revoke(worker, job, unit);
  }
}

/// Quarantines the workers of a witness, until then or until they are allowed again.
void Quarantine::quarantine_witness(const std::string& witness, std::optional<Time> until) {
  const std::set<WorkerKey>& peers = workers_.of_witness(witness);
  if (peers.empty()) return;
  if (Conduct& conduct = conduct_[witness]; !conduct.quarantined || conduct.quarantined_until) {
    conduct.quarantined = true;
    conduct.quarantined_until = until;
  }
  for (const WorkerKey key : peers) {
    Worker& worker = workers_.at(key);
    const bool is_new = !worker.quarantined;
    if (!is_new && !worker.quarantined_until) continue;  // for a graver reason
    worker.quarantined = true;
    worker.quarantined_until = until;
    if (until) {
      timed_quarantines_.insert(key);
    } else {
      timed_quarantines_.erase(key);
    }
    if (!is_new) continue;
    counts_.recount(worker);
    for (const auto& [job, unit] : worker.leased_units)
      outgoing_.revoke(worker, jobs_.at(job), unit);
  }
}

/// Ends a quarantine that quarantine_witness() began with a time.
void Quarantine::end_quarantine(const std::string& witness) {
  const std::set<WorkerKey>& peers = workers_.of_witness(witness);
  if (peers.empty()) return;
  if (Conduct& conduct = conduct_[witness]; conduct.quarantined_until) {
    conduct.quarantined = false;
    conduct.quarantined_until.reset();
  }
  for (const WorkerKey key : peers) {
    Worker& worker = workers_.at(key);
    if (!worker.quarantined_until) continue;
    worker.quarantined = false;
    worker.quarantined_until.reset();
    timed_quarantines_.erase(key);
    counts_.recount(worker);
    ready_.note_work();
  }
}

void Quarantine::set_witness(Worker& worker, std::string witness) {
  if (!worker.witness.empty() && worker.witness != witness) forget_witness(worker);
  worker.witness = std::move(witness);
  const auto conduct = conduct_.find(worker.witness);
  if (conduct != conduct_.end() && conduct->second.quarantined && !worker.quarantined) {
    worker.quarantined = true;
    worker.quarantined_until = conduct->second.quarantined_until;
    if (worker.quarantined_until) timed_quarantines_.insert(worker.key);
  }
  workers_.add_witness(worker);
  if (is_quarantined(worker.id)) {
    worker.quarantined = true;
    worker.quarantined_until.reset();
  }
}

void Quarantine::forget_witness(const Worker& worker) {
  if (workers_.remove_witness(worker)) conduct_.erase(worker.witness);
}

void Quarantine::forget(const Worker& worker) {
  forget_witness(worker);
  timed_quarantines_.erase(worker.key);
}

bool Quarantine::allow(const std::string& worker_id) {
  bool is_known = false;
  for (const std::string& name : names_to_ban(worker_id)) {
    is_known = quarantined_.erase(name) > 0 || is_known;
  }
  const std::string witness = workers_.witness_of(worker_id);
  conduct_.erase(witness);
  const std::set<WorkerKey>& peers = workers_.of_witness(witness);
  if (peers.empty()) return is_known;
  for (const WorkerKey key : peers) {
    Worker& worker = workers_.at(key);
    worker.quarantined = quarantined_.count(worker.id) > 0;  // its own ban may remain
    worker.quarantined_until.reset();
    timed_quarantines_.erase(key);
    counts_.recount(worker);
  }
  ready_.note_work();
  return true;
}

void Quarantine::note_delivered(const std::string& witness) {
  const auto conduct = conduct_.find(witness);
  if (conduct != conduct_.end()) conduct->second.failing_jobs.clear();
}

}  // namespace tessera::server
