#include "server/schedule/tables/lease_table.h"

namespace tessera::server {

using contract::Unit;

void LeaseTable::hold(Job& job, Worker& worker, const Unit& unit, const Holder& holder) {
  constexpr double kUnknownUnitSeconds = 1;  // fair share's assumption before the first result
  Holder charged = holder;
  const auto& pass = job.plan->shape().passes[static_cast<std::size_t>(unit.pass)];
  charged.expected_seconds = job.times.median(pass.sample_count).value_or(kUnknownUnitSeconds);
  charged.charged = ready_.now();
  job.plan->hold(unit, charged);
  worker.leased_units.emplace(job.key, unit);
  ++job.holders[worker.key];
  job.ever_leased_to.insert(worker.key);
  worker.leased_jobs.insert(job.key);
  job.leased_seconds += charged.expected_seconds;
  ready_.take_limits(job);
  ready_.queue().charge(job.spec->owner, charged.expected_seconds, charged.charged);
  counts_.update_idle(worker);
}

void LeaseTable::remove_hold(Job& job, const Unit& unit, const Holder& holder) {
  const auto count = job.holders.find(holder.worker);
  if (count != job.holders.end() && --count->second == 0) job.holders.erase(count);
  job.leased_seconds -= holder.expected_seconds;
  ready_.give_back_limits(job);
  ready_.queue().charge(job.spec->owner, -holder.expected_seconds, holder.charged);
  Worker* worker = workers_.find(holder.worker);
  if (worker == nullptr) return;
  worker->leased_units.erase({job.key, unit});
  counts_.update_idle(*worker);
}

bool LeaseTable::release(Job& job, Worker& worker, const Unit& unit) {
  const auto holder = job.plan->release(unit, worker.key);
  if (!holder) return release_audit(job, worker, unit);
  remove_hold(job, unit, *holder);
  ready_.refresh(job);
  return true;
}

void LeaseTable::hold_audit(Job& job, Worker& worker, const Unit& unit, const Attempt& attempt) {
  Audit& audit = job.audits.at(unit);
  audit.holder = Holder{worker.key, attempt, std::nullopt, false, 0};
  worker.leased_units.emplace(job.key, unit);
  worker.leased_jobs.insert(job.key);
  job.ever_leased_to.insert(worker.key);
  ready_.take_limits(job);
  audits_.stop_waiting(job, unit, audit);
}

bool LeaseTable::release_audit(Job& job, Worker& worker, const Unit& unit) {
  const auto audit = job.audits.find(unit);
  if (audit == job.audits.end() || !audit->second.holder ||
      audit->second.holder->worker != worker.key) {
    return false;
  }
  audit->second.holder.reset();
  worker.leased_units.erase({job.key, unit});
  ready_.give_back_limits(job);
  counts_.update_idle(worker);
  audits_.await_worker(job, unit, audit->second);
  return true;
}

void LeaseTable::take_from_holder(Job& job, const Unit& unit, const Audit& audit) {
  if (!audit.holder) return;
  Worker* worker = workers_.find(audit.holder->worker);
  if (worker == nullptr || worker->leased_units.erase({job.key, unit}) == 0) return;
  ready_.give_back_limits(job);
  counts_.update_idle(*worker);
  outgoing_.revoke(*worker, job, unit);
}

void LeaseTable::suspend_audits(Job& job) {
  for (auto& [unit, audit] : job.audits) {
    audits_.stop_waiting(job, unit, audit);
    take_from_holder(job, unit, audit);
    audit.holder.reset();
    audit.alone_since.reset();  // time without workers counts from the retry
  }
}

void LeaseTable::drop_audits(Job& job) {
  suspend_audits(job);
  job.audits.clear();
  audits_.note_audits(job);
}

}  // namespace tessera::server
