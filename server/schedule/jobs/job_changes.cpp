#include "server/schedule/jobs/job_changes.h"

#include <utility>

namespace tessera::server {

Job& JobChanges::add_job(JobKey key, std::shared_ptr<const JobSpec> spec, JobState state) {
  Job& job = jobs_.add(key, spec->id);
  jobs_.set_state(job, state);
  job.spec = std::move(spec);
  job.scene = scene_key(*job.spec);
  job.requirement = job.spec->requirement();
  JobPlan& plan = job.open_plan();
  job.unit_count = plan.counts().planned;
  job.frame_count = plan.shape().frame_count();
  job.plan.reset();  // a queued job is a row and a cursor
  if (state == JobState::running) job.open_plan();
  job.demand = {1, 0, 0};
  job.is_over_budget = stopped_.reason_for(job) != nullptr;
  if (!has_ended(state)) jobs_.count_demand(job, 1);
  dependencies_.add(key, job.spec->after);
  checks_.check_dependencies(job);
  ready_.refresh(job);
  return job;
}

void JobChanges::extend(Job& job, std::shared_ptr<const JobSpec> spec) {
  leases_.drop_audits(job);
  job.spec = std::move(spec);
  const contract::RenderSettings& settings = job.spec->settings;
  const auto gone =
      job.open_plan().extend(contract::schedule(settings), settings.error.has_value());
  job.unit_count = job.plan->counts().planned;
  for (const auto& [unit, holder] : gone) {
    leases_.remove_hold(job, unit, holder);
    if (Worker* worker = workers_.find(holder.worker)) outgoing_.revoke(*worker, job, unit);
  }
  // The caller restores units from the journal, which counts them again.
  job.counters.cpu_seconds = 0;
  job.contributions.clear();
  ready_.refresh(job);
  checks_.check_dependents(job);
  outgoing_.effects().changed.push_back(job.key);
}

void JobChanges::change(Job& job, std::shared_ptr<const JobSpec> spec, Time now) {
  ready_.advance(now);
  for (auto& [unit, audit] : job.audits) audit_table_.stop_waiting(job, unit, audit);
  ready_.take_out(job);
  ready_.limited().limits().take(job.spec->limits, -job.lease_count);
  dependencies_.replace(job.key, job.spec->after, spec->after);
  job.spec = std::move(spec);
  job.requirement = job.spec->requirement();
  ready_.limited().limits().take(job.spec->limits, job.lease_count);
  for (auto& [unit, audit] : job.audits) {
    if (!audit.holder) audit_table_.await_worker(job, unit, audit);
  }
  for (const std::string& id : job.spec->blocked_workers) {
    if (Worker* worker = workers_.find(id)) outgoing_.revoke_units(*worker, job);
  }
  checks_.check_dependencies(job);
  ready_.refresh(job);
  dispatcher_.dispatch_all(now);
}

void JobChanges::lose_asset(Job& job, const std::string& uri) {
  if (!has_ended(job.state)) job.lost_asset = uri;
}

void JobChanges::find_asset(Job& job, Time now) {
  if (job.lost_asset.empty()) return;
  job.lost_asset.clear();
  ready_.advance(now);
  ready_.note_work();
  dispatcher_.dispatch_all(now);
}

void JobChanges::set_demand(Job& job, double store_bytes, double samples) {
  if (!has_ended(job.state)) jobs_.count_demand(job, -1);
  job.demand = {1, store_bytes, samples};
  if (!has_ended(job.state)) jobs_.count_demand(job, 1);
}

}  // namespace tessera::server
