#include "server/schedule/jobs/job_lifecycle.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {

using contract::Unit;

absl::Status JobLifecycle::pause(Job& job, const std::string& reason, Time now) {
  if (has_ended(job.state)) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " has ended"));
  }
  // One that failures have paused waits for a person anyway; its reason names the failures.
  if (!job.is_paused_by_failures()) states_.set_state(job, JobState::paused, reason, now);
  return absl::OkStatus();
}

absl::Status JobLifecycle::resume(Job& job, Time now) {
  if (has_ended(job.state)) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " has ended"));
  }
  if (job.is_paused_by_failures()) return retry(job, now);
  if (job.state == JobState::paused) {
    states_.set_state(job, job.plan ? JobState::running : JobState::queued, "", now);
    dispatcher_.dispatch_all(now);
  }
  return absl::OkStatus();
}

absl::Status JobLifecycle::cancel(Job& job, Time now) {
  if (job.state == JobState::done || job.state == JobState::failed) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " has ended"));
  }
  if (job.state != JobState::cancelled) end_job(job, JobState::cancelled, "cancelled", now);
  return absl::OkStatus();
}

absl::Status JobLifecycle::retry(Job& job, Time now) {
  if (job.state == JobState::done) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " is done"));
  }
  if (!has_ended(job.state) && !job.is_paused_by_failures()) return absl::OkStatus();
  if (absl::Status possible = checks_.check_possible(job); !possible.ok()) return possible;
  job.unit_failures.clear();
  job.scene_faults.clear();
  job.failed_attempts.clear();
  job.failure_code = absl::StatusCode::kOk;
  job.end_time_us = 0;
  states_.set_state(job, job.plan ? JobState::running : JobState::queued, "", now);
  end_if_finished(job, now);  // its last frame was finished after it had been cancelled
  dispatcher_.dispatch_all(now);
  return absl::OkStatus();
}

void JobLifecycle::end_job(Job& job, JobState state, const std::string& reason, Time now) {
  if (has_ended(job.state)) return;
  ready_.advance(now);
  if (job.plan) {
    std::vector<std::pair<Unit, WorkerKey>> holds;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      for (const Holder& holder : in_flight.holders) holds.emplace_back(unit, holder.worker);
    }
    for (const auto& [unit, key] : holds) {
      Worker* worker = workers_.find(key);
      if (worker == nullptr || !leases_.release(job, *worker, unit)) continue;
      outgoing_.revoke(*worker, job, unit);
    }
  }
  leases_.suspend_audits(job);  // retry() goes on with them
  for (const WorkerKey key : job.ever_leased_to) {
    Worker* worker = workers_.find(key);
    if (worker == nullptr) continue;
    worker->leased_jobs.erase(job.key);
    if (!worker->connected) continue;
    worker->outbox.ended_jobs.push_back(job.spec->id);
    outgoing_.wake(*worker);
  }
  job.ever_leased_to.clear();
  quarantine_.forgive(job);
  if (state != JobState::failed) {
    job.failure_code = absl::StatusCode::kOk;
    job.failed_attempts.clear();
  }
  states_.set_state(job, state, reason, now);
  dispatcher_.dispatch_all(now);
}

void JobLifecycle::fail_job(Job& job, const absl::Status& failure, Time now) {
  if (has_ended(job.state)) return;
  job.failure_code = failure.code();
  end_job(job, JobState::failed, std::string(failure.message()), now);
}

void JobLifecycle::end_if_finished(Job& job, Time now) {
  if (has_ended(job.state) || !job.plan) return;
  if (job.plan->finished_frame_count() < job.plan->shape().frame_count()) return;
  end_job(job, JobState::done, "", now);
}

void JobLifecycle::note_removed(const std::string& job_id, JobState state) {
  const std::set<JobKey> dependents = dependencies_.dependents(job_id);
  if (dependents.empty()) return;
  dependencies_.note_removed(job_id, state);
  for (const JobKey key : dependents) {
    Job& dependent = jobs_.at(key);
    checks_.check_dependencies(dependent);
    ready_.refresh(dependent);
    const absl::Status possible = checks_.check_possible(dependent);
    if (!possible.ok()) fail_job(dependent, possible, ready_.now());
  }
  dispatcher_.dispatch_all(ready_.now());
}

void JobLifecycle::remove_job(JobKey key) {
  Job* job = jobs_.find(key);
  if (job == nullptr) return;
  quarantine_.forgive(*job);
  leases_.drop_audits(*job);
  if (!has_ended(job->state)) jobs_.count_demand(*job, -1);
  const std::string id = job->spec->id;
  const JobState state = job->state;
  dependencies_.remove(key, job->spec->after);
  jobs_.erase(key);
  note_removed(id, state);
}

}  // namespace tessera::server
