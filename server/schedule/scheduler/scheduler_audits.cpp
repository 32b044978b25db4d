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
bool Scheduler::could_audit(const Worker& worker, const Job& job) {
  const std::string& tag = job.spec->required_tag;
  return !worker.lost && !worker.draining && !worker.quarantined &&
         (tag.empty() || worker.tags.count(tag) > 0);
}

bool Scheduler::wants_audit(const Job& job, const Unit& unit, const std::string& worker_id) {
  Worker* worker = find_worker(worker_id);
  const bool is_first = worker != nullptr && !std::exchange(worker->has_delivered, true);
  const double fraction = policy_.audit_fraction;
  const bool is_drawn = (is_first && fraction > 0) ||
                        is_drawn_for_audit(identity_.store_key, job.spec->id, unit, fraction);
  return is_drawn && std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
           return entry.second.id != worker_id && could_audit(entry.second, job);
         });
}

void Scheduler::open_audit(Job& job, const Unit& unit, const std::string& worker_id,
                           const contract::Digest& committed) {
  if (!job.audits.try_emplace(unit, worker_id, committed).second) return;
  waiting_audits_.emplace(job.key, unit);
  work_appeared_ = true;
}

bool Scheduler::has_audits(const Job& job, std::int32_t frame) const {
  constexpr auto kLeast = std::numeric_limits<std::int32_t>::min();
  const auto first = job.audits.lower_bound({frame, kLeast, kLeast});
  return first != job.audits.end() && first->first.frame == frame;
}

/// Returns whether a worker that was not asked yet could be. In a dispute this includes a worker
/// that was lost recently: it may return, and a dispute between two consistent workers fails the
/// job.
bool Scheduler::has_others(const Job& job, const Audit& audit) const {
  const bool is_disputed = audit.is_disputed();
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    const Worker& worker = entry.second;
    if (audit.has_answered(worker.id)) return false;
    const bool may_return = is_disputed && worker.lost && !worker.draining && !worker.quarantined &&
                            last_tick_ && *last_tick_ - worker.last_contact < policy_.audit_timeout;
    return may_return || could_audit(worker, job);
  });
}

bool Scheduler::may_audit(const Worker& worker, const Job& job, const Audit& audit) const {
  if (!could_audit(worker, job) || !audit.may_ask(worker.id, has_others(job, audit))) return false;
  const auto hosts = hosts_.find(job.spec->required_tag);
  if (audit.is_disputed() || hosts == hosts_.end() || hosts->second.size() < 2) return true;
  const auto committer = worker_by_id_.find(audit.committer());  // on another host if possible
  return committer == worker_by_id_.end() || workers_.at(committer->second).host != worker.host;
}

bool Scheduler::lease_audit(Worker& worker) {
  for (const auto& [key, unit] : waiting_audits_) {
    Job& job = jobs_.at(key);
    if (job.state == JobState::paused) continue;
    Audit& audit = job.audits.at(unit);
    if (!may_audit(worker, job, audit)) continue;
    const Lease lease = make_lease(job, worker, {unit.frame, unit.pass, unit.tile, 1});
    audit.holder = Holder{worker.key, lease.attempt, std::nullopt, false, 0};
    worker.leased_units.emplace(key, unit);
    worker.leased_jobs.insert(key);
    job.ever_leased_to.insert(worker.key);
    waiting_audits_.erase({key, unit});
    send_lease(worker, lease);
    return true;
  }
  return false;
}

bool Scheduler::release_audit(Job& job, Worker& worker, const Unit& unit) {
  const auto audit = job.audits.find(unit);
  if (audit == job.audits.end() || !audit->second.holder ||
      audit->second.holder->worker != worker.key) {
    return false;
  }
  audit->second.holder.reset();
  worker.leased_units.erase({job.key, unit});
  waiting_audits_.emplace(job.key, unit);
  work_appeared_ = true;
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
  // The worker's own result, sent again, proves nothing unless it differs.
  if (audit.has_answered(result.worker_id) && !was_asked && !differs) return false;
  if (worker != nullptr) release_audit(job, *worker, unit);
  audit.answer(result.worker_id, result.digest);
  if (audit.is_settled()) end_audit(job, unit, now);
  dispatch_all(now);
  return true;
}

/// Ends an audit whose outcome is known or that no worker can settle.
void Scheduler::end_audit(Job& job, const Unit& unit, Time now) {
  const auto node = job.audits.extract(unit);
  waiting_audits_.erase({job.key, unit});
  const Audit& audit = node.mapped();
  if (audit.holder) {
    Worker* worker = find_worker(audit.holder->worker);
    if (worker != nullptr && worker->leased_units.erase({job.key, unit}) > 0)
      revoke(*worker, job, unit);
  }
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

/// Rejects further results of a faulty worker and releases its units to others.
void Scheduler::quarantine(const std::string& worker_id) {
  if (quarantined_.count(worker_id) > 0) return;
  effects_.faulty_workers.push_back(worker_id);
  ban(worker_id);
}

void Scheduler::drop_audits(Job& job) {
  for (const auto& [unit, audit] : job.audits) {
    waiting_audits_.erase({job.key, unit});
    if (!audit.holder) continue;
    Worker* worker = find_worker(audit.holder->worker);
    if (worker != nullptr && worker->leased_units.erase({job.key, unit}) > 0)
      revoke(*worker, job, unit);
  }
  job.audits.clear();
}

/// Drops audits without a worker to ask; a dispute that cannot be settled fails its job.
void Scheduler::fail_unresolvable_audits(Time now) {
  const bool has_workers = std::any_of(workers_.begin(), workers_.end(),
                                       [](const auto& entry) { return entry.second.is_working(); });
  if (!has_workers || !missing_workers_.empty()) return;
  std::vector<std::pair<JobKey, Unit>> unresolvable;
  int checked = 0;
  for (const auto& [key, unit] : waiting_audits_) {
    if (++checked > kAuditChecksPerTick) break;
    Job& job = jobs_.at(key);
    Audit& audit = job.audits.at(unit);
    const bool others = has_others(job, audit);
    const bool has_candidate =
        job.state == JobState::paused ||
        std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
          return could_audit(entry.second, job) && audit.may_ask(entry.second.id, others);
        });
    if (has_candidate) {
      audit.alone_since.reset();
      continue;
    }
    // Workers that could decide may return soon.
    if (!audit.alone_since) audit.alone_since = now;
    if (!audit.is_disputed() || now - *audit.alone_since >= policy_.audit_timeout) {
      unresolvable.emplace_back(key, unit);
    }
  }
  for (const auto& [key, unit] : unresolvable) {
    Job& job = jobs_.at(key);
    if (job.audits.count(unit) > 0) end_audit(job, unit, now);
  }
}

}  // namespace tessera::server
