#include "server/schedule/outcomes/audits.h"

#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr int kAuditChecksPerTick = 64;  // audits checked per tick for having no worker left

}  // namespace

bool Audits::wants_audit(const Job& job, const Unit& unit, const std::string& worker_id, Time now) {
  const double fraction = policy_.audit_fraction;
  if (fraction == 0) return false;
  // Workers that are not back yet after a restart of the server may be such others.
  if (!absences_.is_grace(now) &&
      !witnesses_.has_witness_beyond(job, {workers_.witness_of(worker_id)})) {
    return false;
  }
  Worker* worker = workers_.find(worker_id);
  const bool is_first = worker != nullptr && !std::exchange(worker->has_been_audited, true);
  return is_first || is_drawn_for_audit(identity_.store_key, job.spec->id, unit, fraction);
}

std::vector<std::string> Audits::note_unaudited(Job& job, const std::string& worker_id, Time now) {
  if (policy_.audit_fraction == 0 || job.is_unaudited || absences_.is_grace(now)) return {};
  const std::string witness = workers_.witness_of(worker_id);
  if (witnesses_.has_witness_beyond(job, {witness})) return {};
  std::vector<std::string> sharers;
  for (const WorkerKey key : workers_.of_witness(witness)) {
    const Worker& worker = workers_.at(key);
    if (witnesses_.could_audit(worker, job)) sharers.push_back(worker.id);
  }
  if (sharers.size() < 2) return {};
  job.is_unaudited = true;
  return sharers;
}

void Audits::open_audit(Job& job, const Unit& unit, const std::string& worker_id,
                        const contract::Digest& committed) {
  const auto [audit, is_new] =
      job.audits.try_emplace(unit, worker_id, committed, workers_.witness_of(worker_id));
  if (!is_new) return;
  audit_table_.await_worker(job, unit, audit->second);
  audit_table_.note_audits(job);
}

bool Audits::has_audits(const Job& job, std::int32_t frame) const {
  constexpr auto kLeast = std::numeric_limits<std::int32_t>::min();
  const auto first = job.audits.lower_bound({frame, kLeast, kLeast});
  return first != job.audits.end() && first->first.frame == frame;
}

bool Audits::answer_audit(Job& job, const Unit& unit, const Lease& lease, const Result& result,
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
  Worker* worker = workers_.find(result.worker_id);
  const bool was_asked = worker != nullptr && audit.holder && audit.holder->worker == worker->key &&
                         audit.holder->attempt == lease.attempt;
  audit.set_committers_witness(workers_.witness_of(audit.committer()));
  const std::string witness = workers_.witness_of(result.worker_id);
  // The worker's own result, sent again, proves nothing unless it differs.
  if (audit.has_answered(witness) && !was_asked && !differs) return false;
  if (worker != nullptr) leases_.release_audit(job, *worker, unit);
  audit_table_.stop_waiting(job, unit, audit);
  audit.answer(result.worker_id, result.digest, witness);
  if (audit.is_settled()) {
    end_audit(job, unit, now);
  } else if (!audit.holder) {
    audit_table_.await_worker(job, unit, audit);
  }
  dispatcher_.dispatch_all(now);
  return true;
}

void Audits::fail_unresolvable_audits(Time now) {
  if (audit_table_.waiting().empty() || counts_.working().find("") == nullptr ||
      absences_.has_missing())
    return;
  std::vector<AuditQueue::Key> ended;
  for (const auto& [tag, groups] : audit_table_.waiting().by_tag()) {
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

/// Ends an audit whose outcome is known or that no worker can settle.
void Audits::end_audit(Job& job, const Unit& unit, Time now) {
  const auto found = job.audits.find(unit);
  Audit& audit = found->second;
  audit_table_.stop_waiting(job, unit, audit);
  leases_.take_from_holder(job, unit, audit);
  audit.holder.reset();
  if (audit.is_disputed() && !audit.is_settled()) {
    audit.restart();  // it stays open for a retry of the job
    return lifecycle_.fail_job(
        job,
        absl::DataLossError(absl::StrCat("job ", job.spec->id, ", frame ", unit.frame, ", tile ",
                                         unit.tile, ", pass ", unit.pass,
                                         ": workers disagree on this unit's pixels and no ",
                                         "other worker is available to decide")),
        now);
  }
  auto node = job.audits.extract(found);
  audit_table_.note_audits(job);
  if (audit.is_settled()) {
    ++job.counters.audited;
    for (const std::string& faulty : audit.faulty_workers()) quarantine(faulty);
  }
  outgoing_.effects().audited.push_back({job.spec->id, unit});
}

/// Rejects further results of a faulty worker, and of all workers with its certificate, and
/// releases their units to others.
void Audits::quarantine(const std::string& worker_id) {
  if (quarantine_.is_quarantined(worker_id)) return;
  const std::set<WorkerKey>& peers = workers_.of_witness(workers_.witness_of(worker_id));
  if (peers.empty()) {
    outgoing_.effects().faulty_workers.push_back(worker_id);
  } else {
    for (const WorkerKey key : peers) {
      outgoing_.effects().faulty_workers.push_back(workers_.at(key).id);
    }
  }
  quarantine_.ban(worker_id);
}

/// Returns the audits of a group of AuditQueue that no worker can settle. Looks at a few only.
std::vector<AuditQueue::Key> Audits::unresolvable(const std::set<AuditQueue::Key>& group,
                                                  Time now) {
  std::vector<AuditQueue::Key> found;
  int checked = 0;
  for (const auto& [key, unit] : group) {
    if (++checked > kAuditChecksPerTick) break;
    counts_.note_step();
    Job& job = jobs_.at(key);
    Audit& audit = job.audits.at(unit);
    if (witnesses_.has_candidate(job, audit)) {
      audit.alone_since.reset();
      if (!audit.group->empty()) break;  // so have the others with this committer
      continue;
    }
    // Workers that could decide may return soon.
    if (!audit.alone_since) audit.alone_since = now;
    const Duration patience = audit.is_disputed() ? policy_.audit_timeout : policy_.restart_grace;
    if (now - *audit.alone_since >= patience) {
      found.emplace_back(key, unit);
    }
  }
  return found;
}

}  // namespace tessera::server
