#include "server/schedule/outcomes/results.h"

namespace tessera::server {

using contract::Unit;

void Results::restore_unit(Job& job, const Unit& unit, const std::string& worker_id,
                           double cpu_seconds) {
  JobPlan& plan = job.open_plan();
  if (!plan.contains(unit)) return;
  if (!plan.is_finished(unit.frame) && !plan.is_committed(unit)) plan.commit(unit);
  restore_contribution(job, worker_id, {1, cpu_seconds});
  job.times.add(cpu_seconds, plan.shape().passes[static_cast<std::size_t>(unit.pass)].sample_count);
  ready_.refresh(job);
}

void Results::restore_frame(Job& job, std::int32_t frame, std::optional<std::int64_t> unit_count) {
  job.open_plan().finish(frame, unit_count);
  ready_.refresh(job);
}

void Results::restore_contribution(Job& job, const std::string& worker_id,
                                   const Contribution& done) {
  Contribution& contribution = job.contributions[worker_id];
  contribution.units += done.units;
  contribution.cpu_seconds += done.cpu_seconds;
  job.counters.cpu_seconds += done.cpu_seconds;
}

bool Results::wants(const Job& job, const Lease& lease, const Unit& unit) const {
  if (has_ended(job.state) || !job.plan || !job.plan->contains(unit)) return false;
  if (job.plan->shape().is_adaptive && unit.pass >= job.plan->shape().first_passes()) {
    const auto voided = job.voided.find(unit.frame);
    if (voided != job.voided.end() && lease.attempt <= voided->second) return false;
  }
  const contract::Pass& pass = job.plan->shape().passes[static_cast<std::size_t>(unit.pass)];
  return lease.covers(unit) && lease.first_sample == pass.first_sample &&
         lease.sample_count == pass.sample_count && !job.plan->is_finished(unit.frame);
}

void Results::commit(Job& job, const Unit& unit, const std::string& worker_id, double cpu_seconds) {
  JobPlan& plan = job.open_plan();
  for (const Holder& holder : plan.commit(unit)) {
    leases_.remove_hold(job, unit, holder);
    Worker* other = workers_.find(holder.worker);
    if (other == nullptr) continue;
    // Its own worker holds an unsent lease if it delivered under an earlier one.
    const bool is_held = other->id != worker_id || other->outbox.has_lease(job.spec->id, unit);
    if (is_held) outgoing_.revoke(*other, job, unit);
  }
  const std::string witness = workers_.witness_of(worker_id);
  quarantine_.disprove_failures(job, unit, witness);
  quarantine_.note_delivered(witness);
  Contribution& contribution = job.contributions[worker_id];
  ++contribution.units;
  contribution.cpu_seconds += cpu_seconds;
  job.counters.cpu_seconds += cpu_seconds;
  ready_.queue().charge(job.spec->owner, cpu_seconds, ready_.now());
  job.times.add(cpu_seconds, plan.shape().passes[static_cast<std::size_t>(unit.pass)].sample_count);
  if (Worker* worker = workers_.find(worker_id)) {
    ++worker->committed_count;
    worker->cpu_seconds += cpu_seconds;
    if (worker->current_job == job.key) worker->seconds_in_job += cpu_seconds;
  }
  ready_.refresh(job);
}

void Results::redo(Job& job, const Unit& unit) {
  if (const auto audit = job.audits.find(unit); audit != job.audits.end()) {
    if (audit->second.holder) {
      leases_.release_audit(job, workers_.at(audit->second.holder->worker), unit);
    }
    audit_table_.stop_waiting(job, unit, audit->second);
    job.audits.erase(audit);
    audit_table_.note_audits(job);
  }
  job.open_plan().redo(unit);
  ++job.counters.redone;
  ready_.refresh(job);
}

void Results::reset_pass_targets(Job& job, std::int32_t frame) {
  if (!job.open_plan().shape().is_adaptive) return;
  job.voided[frame] = grants_.last_attempt();
  for (const auto& [unit, holder] : job.plan->reset_pass_targets(frame)) {
    leases_.remove_hold(job, unit, holder);
    if (Worker* worker = workers_.find(holder.worker)) outgoing_.revoke(*worker, job, unit);
  }
  ready_.refresh(job);
}

void Results::set_pass_target(Job& job, std::int32_t frame, std::int32_t tile,
                              std::int32_t pass_count, bool is_final) {
  if (!job.plan || job.plan->is_finished(frame)) return;
  job.plan->set_pass_target(frame, tile, pass_count, is_final);
  ready_.refresh(job);
}

void Results::release_duplicate(Job& job, const Unit& unit, const std::string& worker_id) {
  if (Worker* worker = workers_.find(worker_id)) leases_.release(job, *worker, unit);
}

void Results::finish_frame(Job& job, std::int32_t frame, Time now) {
  JobPlan& plan = job.open_plan();
  plan.finish(frame);
  ready_.refresh(job);
  checks_.check_dependents(job, frame);
  lifecycle_.end_if_finished(job, now);
  dispatcher_.dispatch_all(now);  // frames of other jobs may have waited for this one
}

}  // namespace tessera::server
