#include "server/schedule/leasing/job_states.h"

namespace tessera::server {

void JobStates::set_state(Job& job, JobState state, const std::string& reason, Time now) {
  if (job.state == state && job.reason == reason) return;
  const bool was_running = job.state == JobState::running;
  if (!has_ended(job.state)) jobs_.count_demand(job, -1);
  jobs_.set_state(job, state);
  if (!has_ended(job.state)) jobs_.count_demand(job, 1);
  job.reason = reason;
  if (was_running && state != JobState::running) {
    job.wall_seconds_before = job.wall_seconds(now);
    job.running_since.reset();
  }
  if (state == JobState::running) {
    if (!job.running_since) job.running_since = now;
    job.open_plan();
  }
  for (auto& [unit, audit] : job.audits) {
    if (state == JobState::paused) {
      audit_table_.stop_waiting(job, unit, audit);
    } else if (!audit.holder) {
      audit_table_.await_worker(job, unit, audit);
    }
  }
  outgoing_.effects().changed.push_back(job.key);
  ready_.refresh(job);
  checks_.check_dependents(job);
}

}  // namespace tessera::server
