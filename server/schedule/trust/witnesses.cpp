#include "server/schedule/trust/witnesses.h"

#include <algorithm>

namespace tessera::server {

using contract::Unit;

bool has_scene(const Worker& worker, const Job& job) {
  return std::find(worker.scenes.begin(), worker.scenes.end(), job.scene) != worker.scenes.end();
}

bool is_barred(const Worker& worker, const Job& job) {
  return job.spec->blocked_workers.count(worker.id) > 0 ||
         (!job.lost_asset.empty() && !has_scene(worker, job));
}

bool Witnesses::could_audit(const Worker& worker, const Job& job) const {
  return worker.is_present && worker.serves.count(job.requirement) > 0 && !is_barred(worker, job);
}

bool Witnesses::has_witness_beyond(const Job& job, const std::set<std::string>& asked) const {
  if (job.spec->blocked_workers.empty() && job.lost_asset.empty()) {
    return counts_.present().has_witness_beyond(job.requirement, asked);
  }
  return std::any_of(workers_.all().begin(), workers_.all().end(), [&](const auto& entry) {
    return could_audit(entry.second, job) && asked.count(entry.second.witness) == 0;
  });
}

bool Witnesses::has_others(const Job& job, const Audit& audit) const {
  if (has_witness_beyond(job, audit.witnesses())) return true;
  if (!audit.is_disputed() || !absences_.last_tick()) return false;
  return std::any_of(workers_.all().begin(), workers_.all().end(), [&](const auto& entry) {
    const Worker& worker = entry.second;
    return worker.may_return() && !is_barred(worker, job) && !audit.has_answered(worker.witness) &&
           *absences_.last_tick() - worker.last_contact < policy_.audit_timeout;
  });
}

bool Witnesses::has_others(const Job& job, const std::set<std::string>& asked) const {
  if (has_witness_beyond(job, asked)) return true;
  if (absences_.is_grace(ready_.now())) return true;
  return std::any_of(workers_.all().begin(), workers_.all().end(), [&](const auto& entry) {
    const Worker& worker = entry.second;
    return worker.may_return() && asked.count(worker.witness) == 0 &&
           worker.serves.count(job.requirement) > 0 && !is_barred(worker, job) &&
           ready_.now() - worker.last_contact < policy_.audit_timeout;
  });
}

bool Witnesses::may_audit(const Worker& worker, const Job& job, const Audit& audit) const {
  if (!could_audit(worker, job)) return false;
  // A committer that was unknown when the audit began may have connected since.
  if (!audit.is_disputed() && workers_.witness_of(audit.committer()) == worker.witness)
    return false;
  if (audit.has_answered(worker.witness) &&
      !audit.may_ask(worker.witness, has_others(job, audit))) {
    return false;
  }
  const FarmCensus::Count* count = counts_.working().find(job.requirement);
  if (audit.is_disputed() || count == nullptr || count->hosts.size() < 2) return true;
  const Worker* committer = workers_.find(audit.committer());  // on another host if possible
  return committer == nullptr || committer->host != worker.host;
}

bool Witnesses::has_candidate(const Job& job, const Audit& audit) const {
  const std::set<std::string> asked = audit.witnesses();
  if (has_witness_beyond(job, asked)) return true;
  if (!audit.is_disputed() || has_others(job, audit)) return false;
  return std::any_of(asked.begin(), asked.end(), [&](const std::string& name) {
    return has_unblocked_witness(job, name) && audit.may_ask(name, false);
  });
}

std::set<std::string> Witnesses::failed_witnesses(const Job& job, const Unit& unit) const {
  std::set<std::string> witnesses;
  if (const auto found = job.unit_failures.find(unit); found != job.unit_failures.end()) {
    witnesses = found->second.witnesses();
  }
  if (const auto faults = job.scene_faults.find(unit.frame); faults != job.scene_faults.end()) {
    witnesses.merge(witnesses_of(faults->second));
  }
  return witnesses;
}

/// Returns whether a worker of the witness is present and not barred from the job.
bool Witnesses::has_unblocked_witness(const Job& job, const std::string& witness) const {
  const std::set<WorkerKey>& peers = workers_.of_witness(witness);
  return std::any_of(peers.begin(), peers.end(),
                     [&](WorkerKey key) { return could_audit(workers_.at(key), job); });
}

}  // namespace tessera::server
