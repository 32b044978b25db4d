#include <algorithm>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr int kAuditChecksPerTick = 64;  // audits checked per tick for having no worker left

}  // namespace

/// Returns whether the worker could be leased units of the job, apart from its current load.
bool Scheduler::could_audit(const Worker& worker, const Job& job) const {
  return worker.is_present && worker.serves.count(job.requirement) > 0 &&
         job.spec->blocked_workers.count(worker.id) == 0;
}

bool Scheduler::wants_audit(const Job& job, const Unit& unit, const std::string& worker_id) {
  Worker* worker = find_worker(worker_id);
  const bool is_first = worker != nullptr && !std::exchange(worker->has_delivered, true);
  const double fraction = policy_.audit_fraction;
  const bool is_drawn = (is_first && fraction > 0) ||
                        is_drawn_for_audit(identity_.store_key, job.spec->id, unit, fraction);
  return is_drawn && has_witness_beyond(job, {witness_of(worker_id)});
}

void Scheduler::open_audit(Job& job, const Unit& unit, const std::string& worker_id,
                           const contract::Digest& committed) {
  const auto [audit, is_new] =
      job.audits.try_emplace(unit, worker_id, committed, witness_of(worker_id));
  if (is_new) await_worker(job, unit, audit->second);
}

/// Lets an audit without a holder wait for a worker, unless its job is paused.
void Scheduler::await_worker(Job& job, const Unit& unit, Audit& audit) {
  if (job.state == JobState::paused || has_ended(job.state)) return;
  waiting_audits_.insert(job.requirement, {job.key, unit}, audit);
  work_appeared_ = true;
}

void Scheduler::stop_waiting(Job& job, const Unit& unit, Audit& audit) {
  waiting_audits_.erase(job.requirement, {job.key, unit}, audit);
}

bool Scheduler::has_audits(const Job& job, std::int32_t frame) const {
  constexpr auto kLeast = std::numeric_limits<std::int32_t>::min();
  const auto first = job.audits.lower_bound({frame, kLeast, kLeast});
  return first != job.audits.end() && first->first.frame == frame;
}

/// Returns whether a worker that is present, and not blocked for the job, has another witness than
/// these.
bool Scheduler::has_witness_beyond(const Job& job, const Names& asked) const {
  if (job.spec->blocked_workers.empty()) {
    return present_.has_witness_beyond(job.requirement, asked);
  }
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    return could_audit(entry.second, job) && asked.count(entry.second.witness) == 0;
  });
}

/// Returns whether a worker of the witness is present and not blocked for the job.
bool Scheduler::has_unblocked_witness(const Job& job, const std::string& witness) const {
  const auto peers = workers_by_witness_.find(witness);
  return peers != workers_by_witness_.end() &&
         std::any_of(peers->second.begin(), peers->second.end(),
                     [&](WorkerKey key) { return could_audit(workers_.at(key), job); });
}

/// Returns whether a witness that was not asked yet could be. In a dispute this includes one whose
/// worker was lost recently: it may return, and a dispute between two consistent workers fails the
/// job.
bool Scheduler::has_others(const Job& job, const Audit& audit) const {
  if (has_witness_beyond(job, audit.witnesses())) return true;
  if (!audit.is_disputed() || !last_tick_) return false;
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    const Worker& worker = entry.second;
    return worker.may_return() && job.spec->blocked_workers.count(worker.id) == 0 &&
           !audit.has_answered(worker.witness) &&
           *last_tick_ - worker.last_contact < policy_.audit_timeout;
  });
}

bool Scheduler::may_audit(const Worker& worker, const Job& job, const Audit& audit) const {
  if (!could_audit(worker, job)) return false;
  // A committer that was unknown when the audit began may have connected since.
  if (!audit.is_disputed() && witness_of(audit.committer()) == worker.witness) return false;
  if (audit.has_answered(worker.witness) &&
      !audit.may_ask(worker.witness, has_others(job, audit))) {
    return false;
  }
  const FarmCensus::Count* count = working_.find(job.requirement);
  if (audit.is_disputed() || count == nullptr || count->hosts.size() < 2) return true;
  const auto committer = worker_by_id_.find(audit.committer());  // on another host if possible
  return committer == worker_by_id_.end() || workers_.at(committer->second).host != worker.host;
}

bool Scheduler::lease_audit(Worker& worker) {
  if (waiting_audits_.empty()) return false;
  return std::any_of(worker.serves.begin(), worker.serves.end(), [&](const std::string& tag) {
    const AuditQueue::Groups* groups = waiting_audits_.find(tag);
    return groups != nullptr && lease_audit_of(*groups, worker);
  });
}

bool Scheduler::lease_audit_of(const AuditQueue::Groups& groups, Worker& worker) {
  for (const auto& [committer, keys] : groups) {
    for (const auto& [key, unit] : keys) {
      ++step_count_;
      Job& job = jobs_.at(key);
      Audit& audit = job.audits.at(unit);
      if (limits().room(job.spec->limits) == 0) continue;
      if (may_audit(worker, job, audit)) {
        lease_audit(job, unit, audit, worker);
        return true;
      }
      // A group of undisputed audits has one committer and one tag: the answer is the same for all.
      if (!committer.empty()) break;
    }
  }
  return false;
}

void Scheduler::lease_audit(Job& job, const Unit& audited, Audit& audit, Worker& worker) {
  const Unit unit = audited;  // stop_waiting() invalidates the reference
  const Lease lease = make_lease(job, worker, {unit.frame, unit.pass, unit.tile, 1});
  audit.holder = Holder{worker.key, lease.attempt, std::nullopt, false, 0};
  worker.leased_units.emplace(job.key, unit);
  worker.leased_jobs.insert(job.key);
  job.ever_leased_to.insert(worker.key);
  take_limits(job);
  stop_waiting(job, unit, audit);
  send_lease(worker, lease);
}

bool Scheduler::release_audit(Job& job, Worker& worker, const Unit& unit) {
  const auto audit = job.audits.find(unit);
  if (audit == job.audits.end() || !audit->second.holder ||
      audit->second.holder->worker != worker.key) {
    return false;
  }
  audit->second.holder.reset();
  worker.leased_units.erase({job.key, unit});
  give_back_limits(job);
  update_idle(worker);
  await_worker(job, unit, audit->second);
  return true;
}

bool Scheduler::answer_audit(Job& job, const Unit& unit, const Lease& lease, const Result& result,
                             const Result& committed, Time now) {
  const bool differs = result.digest != committed.digest;
  auto found = job.audits.find(unit);
  if (found == job.audits.end()) {
    if (!differs || policy_.audit_fraction == 0) return false;
    // One of them is faulty, even if no audit was planned.
    open_audit(job, unit, committed.worker_id, committed.digest);
    found = job.audits.find(unit);
  }
  Audit& audit = found->second;
  Worker* worker = find_worker(result.worker_id);
  const bool was_asked = worker != nullptr && audit.holder && audit.holder->worker == worker->key &&
                         audit.holder->attempt == lease.attempt;
  audit.set_committers_witness(witness_of(audit.committer()));
  const std::string witness = witness_of(result.worker_id);
  // The worker's own result, sent again, proves nothing unless it differs.
  if (audit.has_answered(witness) && !was_asked && !differs) return false;
  if (worker != nullptr) release_audit(job, *worker, unit);
  stop_waiting(job, unit, audit);
  audit.answer(result.worker_id, result.digest, witness);
  if (audit.is_settled()) {
    end_audit(job, unit, now);
  } else if (!audit.holder) {
    await_worker(job, unit, audit);
  }
  dispatch_all(now);
  return true;
}

/// Ends an audit whose outcome is known or that no worker can settle.
void Scheduler::end_audit(Job& job, const Unit& unit, Time now) {
  auto node = job.audits.extract(unit);
  Audit& audit = node.mapped();
  stop_waiting(job, unit, audit);
  take_from_holder(job, unit, audit);
  if (audit.is_settled()) {
    ++job.counters.audited;
    for (const std::string& faulty : audit.faulty_workers()) quarantine(faulty);
  } else if (audit.is_disputed()) {
    fail_job(job,
             absl::DataLossError(absl::StrCat("job ", job.spec->id, ", frame ", unit.frame,
                                              ", tile ", unit.tile, ", pass ", unit.pass,
                                              ": workers disagree on this unit's pixels and no ",
                                              "other worker is available to decide")),
             now);
  }
  effects_.audited.push_back({job.spec->id, unit});
}

/// Revokes the unit of an audit that is leased to a worker.
void Scheduler::take_from_holder(Job& job, const Unit& unit, const Audit& audit) {
  if (!audit.holder) return;
  Worker* worker = find_worker(audit.holder->worker);
  if (worker == nullptr || worker->leased_units.erase({job.key, unit}) == 0) return;
  give_back_limits(job);
  update_idle(*worker);
  revoke(*worker, job, unit);
}

/// Rejects further results of a faulty worker, and of all workers with its certificate, and
/// releases their units to others.
void Scheduler::quarantine(const std::string& worker_id) {
  if (is_quarantined(worker_id)) return;
  const auto peers = workers_by_witness_.find(witness_of(worker_id));
  if (peers == workers_by_witness_.end()) {
    effects_.faulty_workers.push_back(worker_id);
  } else {
    for (const WorkerKey key : peers->second) {
      effects_.faulty_workers.push_back(workers_.at(key).id);
    }
  }
  ban(worker_id);
}

void Scheduler::drop_audits(Job& job) {
  for (auto& [unit, audit] : job.audits) {
    stop_waiting(job, unit, audit);
    take_from_holder(job, unit, audit);
  }
  job.audits.clear();
}

/// Returns whether a worker that is present could answer the audit.
bool Scheduler::has_candidate(const Job& job, const Audit& audit) const {
  const Names asked = audit.witnesses();
  if (has_witness_beyond(job, asked)) return true;
  if (!audit.is_disputed() || has_others(job, audit)) return false;
  return std::any_of(asked.begin(), asked.end(), [&](const std::string& name) {
    return has_unblocked_witness(job, name) && audit.may_ask(name, false);
  });
}

/// Returns the audits of a group of AuditQueue that no worker can settle. Looks at a few only.
std::vector<AuditQueue::Key> Scheduler::unresolvable(const std::set<AuditQueue::Key>& group,
                                                     Time now) {
  std::vector<AuditQueue::Key> found;
  int checked = 0;
  for (const auto& [key, unit] : group) {
    if (++checked > kAuditChecksPerTick) break;
    ++step_count_;
    Job& job = jobs_.at(key);
    Audit& audit = job.audits.at(unit);
    if (has_candidate(job, audit)) {
      audit.alone_since.reset();
      if (!audit.group->empty()) break;  // so have the others with this committer
      continue;
    }
    // Workers that could decide may return soon.
    if (!audit.alone_since) audit.alone_since = now;
    if (!audit.is_disputed() || now - *audit.alone_since >= policy_.audit_timeout) {
      found.emplace_back(key, unit);
    }
  }
  return found;
}

/// Drops audits without a worker to ask; a dispute that cannot be settled fails its job.
void Scheduler::fail_unresolvable_audits(Time now) {
  if (waiting_audits_.empty() || working_.find("") == nullptr || !missing_workers_.empty()) return;
  std::vector<AuditQueue::Key> ended;
  for (const auto& [tag, groups] : waiting_audits_.by_tag()) {
    for (const auto& [committer, group] : groups) {
      const std::vector<AuditQueue::Key> found = unresolvable(group, now);
      ended.insert(ended.end(), found.begin(), found.end());
    }
  }
  for (const auto& [key, unit] : ended) {
    Job& job = jobs_.at(key);
    if (job.audits.count(unit) > 0) end_audit(job, unit, now);
  }
}

}  // namespace tessera::server
