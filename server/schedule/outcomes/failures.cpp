#include "server/schedule/outcomes/failures.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

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

void Failures::fail_unit(WorkerKey key, const Lease& lease, std::int32_t tile, Failure failure,
                         absl::StatusCode code, Time now) {
  ready_.advance(now);
  Worker* worker = workers_.find(key);
  Job* job = jobs_.find(lease.job_id);
  if (worker == nullptr || job == nullptr || has_ended(job->state)) return;
  if (!is_seal_valid(lease, worker->id, identity_.store_key)) return;
  const Unit unit{lease.frame, tile, lease.pass};
  job->open_plan();
  if (!results_.wants(*job, lease, unit) || !LeaseTable::holds(*worker, *job, unit)) return;
  failure.worker_id = worker->id;
  failure.witness = worker->witness;
  if (job->plan->is_committed(unit)) {  // an audit: another worker has rendered the unit
    leases_.release_audit(*job, *worker, unit);
    quarantine_.disprove({worker->witness}, "");
    dispatcher_.dispatch_all(now);
    return;
  }
  leases_.release(*job, *worker, unit);
  if (!job->is_paused_by_failures()) quarantine_.note_failing(*worker, *job, now);
  job->unit_failures[unit].failures.push_back(failure);
  if (is_scene_fault(code)) {
    std::vector<Failure>& faults = job->scene_faults[unit.frame];
    add_fault(faults, failure);
    const std::set<std::string> witnesses = witnesses_of(faults);
    if (static_cast<std::int32_t>(witnesses.size()) >= policy_.witness_limit ||
        !witnesses_.has_others(*job, witnesses)) {
      list_attempts(*job, unit);
      lifecycle_.fail_job(*job, absl::Status(code, absl::StrCat("bad scene: ", failure.message)),
                          now);
      return;
    }
  }
  if (job->is_paused_by_failures() || stops_job(*job, unit)) {
    const std::string reason =
        failure_reason(*job->spec, unit, job->unit_failures.at(unit).failures);
    pause_for_failures(*job, unit, absl::Status(code, reason), now);
    return;
  }
  ready_.note_work();
  dispatcher_.dispatch_all(now);
}

void Failures::lose_unit(Job& job, Worker& worker, const Unit& unit, Time now) {
  if (!leases_.release(job, worker, unit) || has_ended(job.state)) return;
  if (job.plan->is_committed(unit)) return;  // an audit
  UnitFailures& failures = job.unit_failures[unit];
  ++failures.losses_by_witness[worker.witness];
  ++failures.losses_by_worker[worker.id];
  if (++failures.losses <= policy_.loss_limit) return;
  std::set<std::string> witnesses;
  for (const auto& [witness, count] : failures.losses_by_witness) witnesses.insert(witness);
  if (static_cast<std::int32_t>(witnesses.size()) < policy_.witness_limit &&
      witnesses_.has_others(job, witnesses)) {
    return;
  }
  pause_for_failures(
      job, unit,
      absl::UnavailableError(absl::StrCat(describe(*job.spec, unit), " was lost with its worker ",
                                          failures.losses, " times; the last was ", worker.id)),
      now);
}

/// Returns whether the failures of a unit show that somebody must look at the job: there are
/// enough, and independent witnesses agree, or there is nobody else to ask.
bool Failures::stops_job(const Job& job, const Unit& unit) const {
  const std::vector<Failure>& failures = job.unit_failures.at(unit).failures;
  if (static_cast<std::int32_t>(failures.size()) < policy_.failure_limit) return false;
  const std::set<std::string> witnesses = witnesses_of(failures);
  return static_cast<std::int32_t>(witnesses.size()) >= policy_.witness_limit ||
         !witnesses_.has_others(job, witnesses);
}

/// Lists the attempts at the job's units that failed, those of `unit` first.
void Failures::list_attempts(Job& job, const Unit& unit) {
  job.failed_attempts.clear();
  add_attempts(unit, job.unit_failures.at(unit), job.failed_attempts);
  for (const auto& [other, failures] : job.unit_failures) {
    if (other != unit) add_attempts(other, failures, job.failed_attempts);
  }
}

/// Leases no more of the job until somebody has looked at it. Units in flight are finished; if one
/// fails, it is listed too.
void Failures::pause_for_failures(Job& job, const Unit& unit, const absl::Status& failure,
                                  Time now) {
  quarantine_.forgive(job);
  if (job.is_paused_by_failures()) {
    add_attempts(unit, job.unit_failures.at(unit), job.failed_attempts);
    outgoing_.effects().revised.push_back(job.key);
  } else {
    list_attempts(job, unit);
    job.failure_code = failure.ok() ? absl::StatusCode::kUnknown : failure.code();
    states_.set_state(job, JobState::paused, std::string(failure.message()), now);
  }
  ready_.note_work();
  dispatcher_.dispatch_all(now);
}

}  // namespace tessera::server
