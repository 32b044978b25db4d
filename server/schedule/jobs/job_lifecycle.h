#pragma once

#include <string>

#include "absl/status/status.h"
#include "server/schedule/leasing/dependency_checks.h"
#include "server/schedule/leasing/dispatcher.h"
#include "server/schedule/leasing/job_states.h"
#include "server/schedule/tables/tables.h"
#include "server/schedule/trust/quarantine.h"

namespace tessera::server {

/// Pauses, resumes, ends and removes jobs.
class JobLifecycle {
 public:
  JobLifecycle(Tables& tables, Quarantine& quarantine, DependencyChecks& checks, JobStates& states,
               Dispatcher& dispatcher)
      : workers_(tables.workers),
        jobs_(tables.jobs),
        dependencies_(tables.dependencies),
        ready_(tables.ready),
        outgoing_(tables.outgoing),
        leases_(tables.leases),
        quarantine_(quarantine),
        checks_(checks),
        states_(states),
        dispatcher_(dispatcher) {}

  /// Removes an ended job.
  void remove_job(JobKey key);
  /// Stops leasing units of the job; replaces the reason of an earlier pause, but not failures.
  /// Errors: FailedPrecondition, the job has ended.
  absl::Status pause(Job& job, const std::string& reason, Time now);
  /// Resumes a paused job; one that is paused because of failures like retry().
  absl::Status resume(Job& job, Time now);
  /// Errors: FailedPrecondition, the job is done or failed.
  absl::Status cancel(Job& job, Time now);
  /// Resumes a job that has failed, was cancelled or is paused because of failures, with failure
  /// counts reset to zero. Errors: FailedPrecondition, the job is done.
  absl::Status retry(Job& job, Time now);
  /// Ends the job: revokes its leases and notifies all workers that ever had one.
  void end_job(Job& job, JobState state, const std::string& reason, Time now);
  /// Ends the job as failed, with the code and message of `failure`. Ignored if it has ended.
  void fail_job(Job& job, const absl::Status& failure, Time now);
  /// Ends the job as done if all its frames are finished.
  void end_if_finished(Job& job, Time now);
  /// Notes that a job was removed in this state, and fails the jobs that can never be leased for
  /// that reason. For jobs removed before a restart.
  void note_removed(const std::string& job_id, JobState state);

 private:
  WorkerTable& workers_;
  JobTable& jobs_;
  Dependencies& dependencies_;
  ReadyJobs& ready_;
  Outgoing& outgoing_;
  LeaseTable& leases_;
  Quarantine& quarantine_;
  DependencyChecks& checks_;
  JobStates& states_;
  Dispatcher& dispatcher_;
};

}  // namespace tessera::server
