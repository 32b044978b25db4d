#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

using contract::Unit;

absl::Status check_client_priority(const SchedulePolicy& policy, std::int32_t priority) {
  if (priority <= policy.client_priority) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("priority: ", priority, " is above ", policy.client_priority,
                   ", the maximum for clients of this farm; ask an admin"));
}

Scheduler::Scheduler(Identity identity, SchedulePolicy policy,
                     const std::vector<std::string>& roster, Time start)
    : identity_(std::move(identity)),
      policy_(std::move(policy)),
      queue_(policy_.share, start),
      missing_workers_(roster.begin(), roster.end()),
      grace_ends_(start + policy_.restart_grace),
      now_(start),
      last_advance_(start) {}

/// Notes the time. Call first in every function that is given one.
void Scheduler::advance(Time now) {
  constexpr std::chrono::minutes kPeriod{1};
  now_ = std::max(now_, now);
  if (now_ - last_advance_ < kPeriod) return;
  last_advance_ = now_;
  queue_.advance(now_);
}

Job& Scheduler::add_job(JobKey key, std::shared_ptr<const JobSpec> spec, JobState state) {
  Job& job = jobs_[key];
  job.key = key;
  job.state = state;
  job_by_id_[spec->id] = key;
  job.spec = std::move(spec);
  job.scene = scene_key(*job.spec);
  job.requirement = job.spec->requirement();
  JobPlan& plan = job.open_plan();
  job.unit_count = plan.unit_count();
  job.frame_count = plan.frame_count();
  job.plan.reset();  // a queued job is a row and a cursor
  if (state == JobState::running) job.open_plan();
  job.demand = {1, 0, 0};
  job.is_over_budget = stop_reason(job) != nullptr;
  if (!has_ended(state)) count_demand(job, 1);
  dependencies_.add(key, job.spec->after);
  check_dependencies(job);
  refresh(job);
  return job;
}

Job* Scheduler::find_job(JobKey key) {
  const auto found = jobs_.find(key);
  return found == jobs_.end() ? nullptr : &found->second;
}

Job* Scheduler::find_job(const std::string& id) {
  const auto found = job_by_id_.find(id);
  return found == job_by_id_.end() ? nullptr : find_job(found->second);
}

void Scheduler::restore_unit(Job& job, const Unit& unit, const std::string& worker_id,
                             double cpu_seconds) {
  JobPlan& plan = job.open_plan();
  if (!plan.contains(unit)) return;
  if (!plan.is_finished(unit.frame) && !plan.is_committed(unit)) plan.commit(unit);
  restore_contribution(job, worker_id, {1, cpu_seconds});
  job.times.add(cpu_seconds, plan.passes()[static_cast<std::size_t>(unit.pass)].sample_count);
  refresh(job);
}

void Scheduler::restore_frame(Job& job, std::int32_t frame,
                              std::optional<std::int64_t> unit_count) {
  job.open_plan().finish(frame, unit_count);
  refresh(job);
}

void Scheduler::restore_contribution(Job& job, const std::string& worker_id,
                                     const Contribution& done) {
  Contribution& contribution = job.contributions[worker_id];
  contribution.units += done.units;
  contribution.cpu_seconds += done.cpu_seconds;
  job.counters.cpu_seconds += done.cpu_seconds;
}

void Scheduler::count_demand(const Job& job, int sign) {
  Demand& sum = demands_[job.spec->owner];
  sum.jobs += sign * job.demand.jobs;
  sum.store_bytes += sign * job.demand.store_bytes;
  sum.samples += sign * job.demand.samples;
  if (sum.jobs == 0) demands_.erase(job.spec->owner);  // and with it what rounding has left
}

void Scheduler::set_demand(Job& job, double store_bytes, double samples) {
  if (!has_ended(job.state)) count_demand(job, -1);
  job.demand = {1, store_bytes, samples};
  if (!has_ended(job.state)) count_demand(job, 1);
}

Demand Scheduler::demand(const std::string& owner) const {
  const auto found = demands_.find(owner);
  return found == demands_.end() ? Demand{} : found->second;
}

JobQueue::QueueKey Scheduler::queue_key(const Job& job) {
  return {job.spec->priority, job.spec->owner, job.scene,
          LimitedQueues::name(job.requirement, job.spec->limits)};
}

/// Returns whether the job has its maximum of workers.
bool Scheduler::is_full(const Job& job) {
  const std::int32_t limit = job.spec->max_workers;
  return limit > 0 && static_cast<std::int32_t>(job.holders.size()) >= limit;
}

/// Brings the indexes up to date. Call after the job's state, its units or their holders have
/// changed.
void Scheduler::refresh(Job& job) {
  const bool is_runnable = job.is_runnable();
  const bool belongs_in_queue = is_runnable && !is_full(job);
  const bool is_queued = queued_.count(job.key) > 0;
  if (belongs_in_queue && !is_queued) {
    queued_.insert(job.key);
    queue_.insert(job.key, queue_key(job), now_, working_.threads(job.requirement));
    limited_.count(job.requirement, job.spec->limits, 1);
  } else if (!belongs_in_queue && is_queued) {
    queued_.erase(job.key);
    queue_.erase(job.key, queue_key(job));
    limited_.count(job.requirement, job.spec->limits, -1);
  }
  const auto note = [&](std::set<JobKey>& jobs, bool belongs) {
    if (belongs) {
      jobs.insert(job.key);
    } else {
      jobs.erase(job.key);
    }
  };
  note(full_, is_runnable && !belongs_in_queue);
  note(tail_, job.state == JobState::running && !is_runnable && !job.is_over_budget && job.plan &&
                  job.plan->in_flight_count() > 0);
  if (is_runnable) work_appeared_ = true;
  if (!is_runnable || !job.holders.empty()) {
    job.waiting_since.reset();
  } else if (!job.waiting_since) {
    job.waiting_since = now_;
  }
}

void Scheduler::set_state(Job& job, JobState state, const std::string& reason, Time now) {
  if (job.state == state && job.reason == reason) return;
  const bool was_running = job.state == JobState::running;
  if (!has_ended(job.state)) count_demand(job, -1);
  job.state = state;
  if (!has_ended(job.state)) count_demand(job, 1);
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
      stop_waiting(job, unit, audit);
    } else if (!audit.holder) {
      await_worker(job, unit, audit);
    }
  }
  effects_.changed.push_back(job.key);
  refresh(job);
  check_dependents(job);
}

const Job* Scheduler::find_job(const std::string& id) const {
  const auto found = job_by_id_.find(id);
  return found == job_by_id_.end() ? nullptr : &jobs_.at(found->second);
}

absl::Status Scheduler::pause(Job& job, const std::string& reason, Time now) {
  if (has_ended(job.state)) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " has ended"));
  }
  // One that failures have paused waits for a person anyway; its reason names the failures.
  if (!job.is_paused_by_failures()) set_state(job, JobState::paused, reason, now);
  return absl::OkStatus();
}

absl::Status Scheduler::resume(Job& job, Time now) {
  if (has_ended(job.state)) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " has ended"));
  }
  if (job.is_paused_by_failures()) return retry(job, now);
  if (job.state == JobState::paused) {
    set_state(job, job.plan ? JobState::running : JobState::queued, "", now);
    dispatch_all(now);
  }
  return absl::OkStatus();
}

absl::Status Scheduler::cancel(Job& job, Time now) {
  if (job.state == JobState::done || job.state == JobState::failed) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " has ended"));
  }
  if (job.state != JobState::cancelled) end_job(job, JobState::cancelled, "cancelled", now);
  return absl::OkStatus();
}

absl::Status Scheduler::retry(Job& job, Time now) {
  if (job.state == JobState::done) {
    return absl::FailedPreconditionError(absl::StrCat("job ", job.spec->id, " is done"));
  }
  if (!has_ended(job.state) && !job.is_paused_by_failures()) return absl::OkStatus();
  if (absl::Status possible = check_possible(job); !possible.ok()) return possible;
  job.unit_failures.clear();
  job.scene_faults.clear();
  job.failed_attempts.clear();
  job.failure_code = absl::StatusCode::kOk;
  job.end_time_us = 0;
  set_state(job, job.plan ? JobState::running : JobState::queued, "", now);
  end_if_finished(job, now);  // its last frame was finished after it had been cancelled
  dispatch_all(now);
  return absl::OkStatus();
}

void Scheduler::fail_job(Job& job, const absl::Status& failure, Time now) {
  if (has_ended(job.state)) return;
  job.failure_code = failure.code();
  end_job(job, JobState::failed, std::string(failure.message()), now);
}

void Scheduler::end_job(Job& job, JobState state, const std::string& reason, Time now) {
  if (has_ended(job.state)) return;
  advance(now);
  if (job.plan) {
    std::vector<std::pair<Unit, WorkerKey>> holds;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      for (const Holder& holder : in_flight.holders) holds.emplace_back(unit, holder.worker);
    }
    for (const auto& [unit, key] : holds) {
      Worker* worker = find_worker(key);
      if (worker == nullptr || !release(job, *worker, unit)) continue;
      revoke(*worker, job, unit);
    }
  }
  drop_audits(job);
  for (const WorkerKey key : job.ever_leased_to) {
    Worker* worker = find_worker(key);
    if (worker == nullptr) continue;
    worker->leased_jobs.erase(job.key);
    if (!worker->connected) continue;
    worker->outbox.ended_jobs.push_back(job.spec->id);
    wake(*worker);
  }
  job.ever_leased_to.clear();
  forgive(job);
  if (state != JobState::failed) {
    job.failure_code = absl::StatusCode::kOk;
    job.failed_attempts.clear();
  }
  set_state(job, state, reason, now);
  dispatch_all(now);
}

void Scheduler::extend(Job& job, std::shared_ptr<const JobSpec> spec) {
  drop_audits(job);
  job.spec = std::move(spec);
  const contract::RenderSettings& settings = job.spec->settings;
  const auto gone =
      job.open_plan().extend(contract::schedule(settings), settings.error.has_value());
  job.unit_count = job.plan->unit_count();
  for (const auto& [unit, holder] : gone) {
    remove_hold(job, unit, holder);
    if (Worker* worker = find_worker(holder.worker)) revoke(*worker, job, unit);
  }
  // The caller restores units from the journal, which counts them again.
  job.counters.cpu_seconds = 0;
  job.contributions.clear();
  refresh(job);
  check_dependents(job);
  effects_.changed.push_back(job.key);
}

void Scheduler::remove_job(JobKey key) {
  const auto found = jobs_.find(key);
  if (found == jobs_.end()) return;
  forgive(found->second);
  if (!has_ended(found->second.state)) count_demand(found->second, -1);
  const std::string id = found->second.spec->id;
  const JobState state = found->second.state;
  dependencies_.remove(key, found->second.spec->after);
  job_by_id_.erase(id);
  jobs_.erase(found);
  note_removed(id, state);
}

bool Scheduler::wants(const Job& job, const Lease& lease, const Unit& unit) const {
  if (has_ended(job.state) || !job.plan || !job.plan->contains(unit)) return false;
  if (job.plan->is_adaptive() && unit.pass >= job.plan->first_passes()) {
    const auto voided = job.voided.find(unit.frame);
    if (voided != job.voided.end() && lease.attempt <= voided->second) return false;
  }
  const contract::Pass& pass = job.plan->passes()[static_cast<std::size_t>(unit.pass)];
  return lease.covers(unit) && lease.first_sample == pass.first_sample &&
         lease.sample_count == pass.sample_count && !job.plan->is_finished(unit.frame);
}

void Scheduler::commit(Job& job, const Unit& unit, const std::string& worker_id,
                       double cpu_seconds) {
  JobPlan& plan = job.open_plan();
  for (const Holder& holder : plan.commit(unit)) {
    remove_hold(job, unit, holder);
    Worker* other = find_worker(holder.worker);
    if (other == nullptr) continue;
    // Its own worker holds an unsent lease if it delivered under an earlier one.
    const bool is_held = other->id != worker_id || other->outbox.has_lease(job.spec->id, unit);
    if (is_held) revoke(*other, job, unit);
  }
  const std::string witness = witness_of(worker_id);
  disprove_failures(job, unit, witness);
  if (const auto conduct = conduct_.find(witness); conduct != conduct_.end()) {
    conduct->second.failing_jobs.clear();
  }
  Contribution& contribution = job.contributions[worker_id];
  ++contribution.units;
  contribution.cpu_seconds += cpu_seconds;
  job.counters.cpu_seconds += cpu_seconds;
  queue_.charge(job.spec->owner, cpu_seconds, now_);
  job.times.add(cpu_seconds, plan.passes()[static_cast<std::size_t>(unit.pass)].sample_count);
  if (Worker* worker = find_worker(worker_id)) {
    ++worker->committed_count;
    worker->cpu_seconds += cpu_seconds;
    if (worker->current_job == job.key) worker->seconds_in_job += cpu_seconds;
  }
  refresh(job);
}

void Scheduler::redo(Job& job, const Unit& unit) {
  if (const auto audit = job.audits.find(unit); audit != job.audits.end()) {
    if (audit->second.holder) {
      release_audit(job, workers_.at(audit->second.holder->worker), unit);
    }
    stop_waiting(job, unit, audit->second);
    job.audits.erase(audit);
  }
  job.open_plan().redo(unit);
  ++job.counters.redone;
  refresh(job);
}

void Scheduler::reset_pass_targets(Job& job, std::int32_t frame) {
  if (!job.open_plan().is_adaptive()) return;
  job.voided[frame] = {identity_.boot, last_attempt_};
  for (const auto& [unit, holder] : job.plan->reset_pass_targets(frame)) {
    remove_hold(job, unit, holder);
    if (Worker* worker = find_worker(holder.worker)) revoke(*worker, job, unit);
  }
  refresh(job);
}

void Scheduler::release_duplicate(Job& job, const Unit& unit, const std::string& worker_id) {
  if (Worker* worker = find_worker(worker_id)) release(job, *worker, unit);
}

void Scheduler::set_pass_target(Job& job, std::int32_t frame, std::int32_t tile,
                                std::int32_t pass_count, bool is_final) {
  if (!job.plan || job.plan->is_finished(frame)) return;
  job.plan->set_pass_target(frame, tile, pass_count, is_final);
  refresh(job);
}

void Scheduler::finish_frame(Job& job, std::int32_t frame, Time now) {
  JobPlan& plan = job.open_plan();
  plan.finish(frame);
  refresh(job);
  check_dependents(job, frame);
  end_if_finished(job, now);
  dispatch_all(now);  // frames of other jobs may have waited for this one
}

void Scheduler::end_if_finished(Job& job, Time now) {
  if (has_ended(job.state) || !job.plan) return;
  if (job.plan->finished_frame_count() < job.plan->frame_count()) return;
  end_job(job, JobState::done, "", now);
}

Effects Scheduler::take_effects() {
  queue_.sort();
  effects_.to_wake.assign(to_wake_.begin(), to_wake_.end());
  to_wake_.clear();
  return std::exchange(effects_, Effects{});
}

}  // namespace tessera::server
