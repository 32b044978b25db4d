// Failures and losses of units. They count by witness, so that one faulty worker fails no job.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

using contract::Unit;

namespace {

std::string describe(const JobSpec& spec, const Unit& unit) {
  return absl::StrCat("job ", spec.id, ", frame ", unit.frame, ", tile ", unit.tile, ", pass ",
                      unit.pass);
}

/// Returns whether a unit failed because of its scene, so that every worker would fail.
bool is_scene_fault(absl::StatusCode code) {
  return code == absl::StatusCode::kInvalidArgument || code == absl::StatusCode::kNotFound ||
         code == absl::StatusCode::kUnimplemented;
}

std::string failure_reason(const JobSpec& spec, const Unit& unit,
                           const std::vector<Failure>& failures) {
  std::string reason = absl::StrCat(describe(spec, unit), " failed ", failures.size(), " times");
  if (witnesses_of(failures).size() == 1) {
    absl::StrAppend(&reason, ", on one worker; there is no other worker to confirm it");
  }
  for (const Failure& failure : failures) {
    absl::StrAppend(&reason, "\nworker ", failure.worker_id, ": ", failure.message);
    if (!failure.log_tail.empty()) absl::StrAppend(&reason, "\n", failure.log_tail);
  }
  return reason;
}

constexpr std::size_t kMaxAttempts = 100;  // listed of a job

/// Lists the failures and losses of a unit for users, unless they are listed.
void add_attempts(const Unit& unit, const UnitFailures& failures,
                  std::vector<FailedAttempt>& attempts) {
  const std::size_t before = attempts.size();
  const auto add = [&](const std::string& worker_id, const std::string& message) {
    const FailedAttempt attempt{unit, worker_id, message};
    const auto listed = attempts.begin() + static_cast<std::ptrdiff_t>(before);
    if (attempts.size() < kMaxAttempts && std::find(attempts.begin(), listed, attempt) == listed) {
      attempts.push_back(attempt);
    }
  };
  for (const Failure& failure : failures.failures) add(failure.worker_id, failure.message);
  for (const auto& [worker_id, losses] : failures.losses_by_worker) {
    add(worker_id,
        absl::StrCat("lost with its worker, ", losses, losses == 1 ? " time" : " times"));
  }
}

/// Adds a scene fault unless the witness has reported one.
void add_fault(std::vector<Failure>& faults, const Failure& failure) {
  const bool is_known = std::any_of(faults.begin(), faults.end(), [&](const Failure& fault) {
    return fault.witness == failure.witness;
  });
  if (!is_known) faults.push_back(failure);
}

}  // namespace

/// Returns whether a witness beyond those asked can render the job, or may be back soon: after a
/// restart, or after a loss of its connection. Otherwise one worker could fail a job while the
/// others are away for a moment.
bool Scheduler::has_others(const Job& job, const Names& asked) const {
  if (has_witness_beyond(job, asked)) return true;
  if (!missing_workers_.empty() && now_ < grace_ends_) return true;
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    const Worker& worker = entry.second;
    return worker.may_return() && asked.count(worker.witness) == 0 &&
           worker.serves.count(job.requirement) > 0 &&
           job.spec->blocked_workers.count(worker.id) == 0 &&
           now_ - worker.last_contact < policy_.audit_timeout;
  });
}

/// Returns the witnesses on which the unit failed or its frame's scene was found at fault.
Scheduler::Names Scheduler::failed_witnesses(const Job& job, const Unit& unit) const {
  Names witnesses;
  if (const auto found = job.unit_failures.find(unit); found != job.unit_failures.end()) {
    witnesses = found->second.witnesses();
  }
  if (const auto faults = job.scene_faults.find(unit.frame); faults != job.scene_faults.end()) {
    witnesses.merge(witnesses_of(faults->second));
  }
  return witnesses;
}

/// Returns whether the failures of a unit show that somebody must look at the job: there are
/// enough, and independent witnesses agree, or there is nobody else to ask.
bool Scheduler::stops_job(const Job& job, const Unit& unit) const {
  const std::vector<Failure>& failures = job.unit_failures.at(unit).failures;
  if (static_cast<std::int32_t>(failures.size()) < policy_.failure_limit) return false;
  const Names witnesses = witnesses_of(failures);
  return static_cast<std::int32_t>(witnesses.size()) >= policy_.witness_limit ||
         !has_others(job, witnesses);
}

void Scheduler::fail_unit(WorkerKey key, const Lease& lease, std::int32_t tile, Failure failure,
                          absl::StatusCode code, Time now) {
  advance(now);
  Worker* worker = find_worker(key);
  Job* job = find_job(lease.job_id);
  if (worker == nullptr || job == nullptr || has_ended(job->state)) return;
  if (!is_seal_valid(lease, worker->id, identity_.store_key)) return;
  const Unit unit{lease.frame, tile, lease.pass};
  job->open_plan();
  if (!wants(*job, lease, unit) || !holds(*worker, *job, unit)) return;
  failure.worker_id = worker->id;
  failure.witness = worker->witness;
  if (job->plan->is_committed(unit)) {  // an audit: another worker has rendered the unit
    release_audit(*job, *worker, unit);
    disprove({worker->witness}, "");
    dispatch_all(now);
    return;
  }
  release(*job, *worker, unit);
  if (!job->is_paused_by_failures()) note_failing(*worker, *job, now);
  job->unit_failures[unit].failures.push_back(failure);
  if (is_scene_fault(code)) {
    std::vector<Failure>& faults = job->scene_faults[unit.frame];
    add_fault(faults, failure);
    const Names witnesses = witnesses_of(faults);
    if (static_cast<std::int32_t>(witnesses.size()) >= policy_.witness_limit ||
        !has_others(*job, witnesses)) {
      list_attempts(*job, unit);
      fail_job(*job, absl::Status(code, absl::StrCat("bad scene: ", failure.message)), now);
      return;
    }
  }
  if (job->is_paused_by_failures() || stops_job(*job, unit)) {
    const std::string reason =
        failure_reason(*job->spec, unit, job->unit_failures.at(unit).failures);
    pause_for_failures(*job, unit, absl::Status(code, reason), now);
    return;
  }
  work_appeared_ = true;
  dispatch_all(now);
}

void Scheduler::lose_unit(Job& job, Worker& worker, const Unit& unit, Time now) {
  if (!release(job, worker, unit) || has_ended(job.state)) return;
  if (job.plan->is_committed(unit)) return;  // an audit
  UnitFailures& failures = job.unit_failures[unit];
  ++failures.losses_by_witness[worker.witness];
  ++failures.losses_by_worker[worker.id];
  if (++failures.losses <= policy_.loss_limit) return;
  Names witnesses;
  for (const auto& [witness, count] : failures.losses_by_witness) witnesses.insert(witness);
  if (static_cast<std::int32_t>(witnesses.size()) < policy_.witness_limit &&
      has_others(job, witnesses)) {
    return;
  }
  pause_for_failures(
      job, unit,
      absl::UnavailableError(absl::StrCat(describe(*job.spec, unit), " was lost with its worker ",
                                          failures.losses, " times; the last was ", worker.id)),
      now);
}

/// Lists the attempts at the job's units that failed, those of `unit` first.
void Scheduler::list_attempts(Job& job, const Unit& unit) {
  job.failed_attempts.clear();
  add_attempts(unit, job.unit_failures.at(unit), job.failed_attempts);
  for (const auto& [other, failures] : job.unit_failures) {
    if (other != unit) add_attempts(other, failures, job.failed_attempts);
  }
}

/// Leases no more of the job until somebody has looked at it. Units in flight are finished; if one
/// fails, it is listed too.
void Scheduler::pause_for_failures(Job& job, const Unit& unit, const absl::Status& failure,
                                   Time now) {
  forgive(job);
  if (job.is_paused_by_failures()) {
    add_attempts(unit, job.unit_failures.at(unit), job.failed_attempts);
    effects_.revised.push_back(job.key);
  } else {
    list_attempts(job, unit);
    job.failure_code = failure.ok() ? absl::StatusCode::kUnknown : failure.code();
    set_state(job, JobState::paused, std::string(failure.message()), now);
  }
  work_appeared_ = true;
  dispatch_all(now);
}

/// Counts a failure against the worker until it delivers a unit or the job ends. One that fails
/// units of several jobs is quarantined for a time if there is another.
void Scheduler::note_failing(Worker& worker, Job& job, Time now) {
  Conduct& conduct = conduct_[worker.witness];
  conduct.failing_jobs.insert(job.key);
  job.failed_by.insert(worker.witness);
  if (static_cast<std::int32_t>(conduct.failing_jobs.size()) < policy_.failing_job_limit) return;
  if (working_.has_witness_beyond("", {worker.witness})) {
    quarantine_witness(worker.witness, now + policy_.quarantine_time);
  }
}

/// The job has ended: its failures no longer count against workers. Failures that others disproved
/// have been counted.
void Scheduler::forgive(Job& job) {
  for (const std::string& witness : std::exchange(job.failed_by, {})) {
    const auto conduct = conduct_.find(witness);
    if (conduct == conduct_.end()) continue;
    conduct->second.failing_jobs.erase(job.key);
    const auto count = static_cast<std::int32_t>(conduct->second.failing_jobs.size());
    if (count < policy_.failing_job_limit) end_quarantine(witness);
  }
  job.scene_faults.clear();
}

/// Another witness rendered what these failed.
void Scheduler::disprove(const Names& failed, const std::string& witness) {
  for (const std::string& name : failed) {
    if (name == witness || workers_by_witness_.count(name) == 0) continue;
    if (++conduct_[name].disproved >= policy_.disproved_limit)
      quarantine_witness(name, std::nullopt);
  }
}

void Scheduler::disprove_failures(Job& job, const Unit& unit, const std::string& witness) {
  if (job.unit_failures.empty() && job.scene_faults.empty()) return;
  Names failed;
  if (const auto failures = job.unit_failures.find(unit); failures != job.unit_failures.end()) {
    failed = witnesses_of(failures->second.failures);
    job.unit_failures.erase(failures);
  }
  if (const auto faults = job.scene_faults.find(unit.frame); faults != job.scene_faults.end()) {
    failed.merge(witnesses_of(faults->second));
    job.scene_faults.erase(faults);
  }
  disprove(failed, witness);
}

/// Quarantines the workers of a witness, until then or until they are allowed again.
void Scheduler::quarantine_witness(const std::string& witness, std::optional<Time> until) {
  const auto peers = workers_by_witness_.find(witness);
  if (peers == workers_by_witness_.end()) return;
  for (const WorkerKey key : peers->second) {
    Worker& worker = workers_.at(key);
    const bool is_new = !worker.quarantined;
    if (!is_new && !worker.quarantined_until) continue;  // for a graver reason
    worker.quarantined = true;
    worker.quarantined_until = until;
    if (until) {
      timed_quarantines_.insert(key);
    } else {
      timed_quarantines_.erase(key);
    }
    if (!is_new) continue;
    recount(worker);
    for (const auto& [job, unit] : worker.leased_units) revoke(worker, jobs_.at(job), unit);
  }
}

/// Ends a quarantine that quarantine_witness() began with a time.
void Scheduler::end_quarantine(const std::string& witness) {
  const auto peers = workers_by_witness_.find(witness);
  if (peers == workers_by_witness_.end()) return;
  for (const WorkerKey key : peers->second) {
    Worker& worker = workers_.at(key);
    if (!worker.quarantined_until) continue;
    worker.quarantined = false;
    worker.quarantined_until.reset();
    timed_quarantines_.erase(key);
    recount(worker);
    work_appeared_ = true;
  }
}

void Scheduler::end_timed_quarantines(Time now) {
  const std::set<WorkerKey> keys = timed_quarantines_;
  for (const WorkerKey key : keys) {
    const Worker& worker = workers_.at(key);
    if (!worker.quarantined_until || *worker.quarantined_until > now) continue;
    const std::string witness = worker.witness;
    conduct_[witness].failing_jobs.clear();
    end_quarantine(witness);
  }
}

}  // namespace tessera::server
