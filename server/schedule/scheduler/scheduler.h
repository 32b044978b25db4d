#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "server/schedule/plan/job.h"
#include "server/schedule/queue/audit_queue.h"
#include "server/schedule/queue/dependencies.h"
#include "server/schedule/queue/job_queue.h"
#include "server/schedule/queue/limited_queues.h"
#include "server/schedule/workers/farm_census.h"
#include "server/schedule/workers/placement.h"
#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// Constants of the schedule (docs/reference/limits.md, docs/explanation/fault-tolerance.md).
struct SchedulePolicy {
  Duration worker_timeout = std::chrono::seconds(5);  // silence after which a worker is lost
  Duration restart_grace = std::chrono::seconds(5);   // after a start, leases wait this long for
                                                      // known workers
  Duration timer_slack = std::chrono::seconds(1);     // a tick that is later than this extends all
                                                      // timeouts
  Duration forget_after = std::chrono::hours(1);      // lost workers are listed this long
  std::int32_t failure_limit = 3;                     // failures of a unit that pause its job
  std::int32_t witness_limit = 2;      // of them, by independent witnesses, where there are others
  std::int32_t loss_limit = 10;        // losses of a unit that its job survives
  std::int32_t disproved_limit = 3;    // failures disproved by others that quarantine a worker
  std::int32_t failing_job_limit = 3;  // jobs of which a worker failed units, none delivered in
                                       // between, that quarantine it
  Duration quarantine_time = std::chrono::minutes(10);
  std::int32_t client_priority = 100;             // maximum for jobs of clients; admins may use any
  std::size_t max_outbox = std::size_t{1} << 17;  // messages that a worker may leave unread
  SharePolicy share;
  Duration audit_timeout = std::chrono::minutes(1);  // a dispute waits this long for other workers
  double audit_fraction = 0.01;  // fraction of units that another worker renders again
  double load_factor = 10;       // a worker stays with a job for this many scene load times
};

/// Checks the priority of a job that a client creates. Errors: PermissionDenied, it is above the
/// clients' maximum.
absl::Status check_client_priority(const SchedulePolicy& policy, std::int32_t priority);

/// Actions the coordinator must carry out.
struct Effects {
  std::vector<WorkerKey> to_wake;          // workers with messages in the outbox
  std::vector<WorkerKey> to_close;         // lost workers whose stream, if any, must be closed
  std::vector<WorkerKey> to_close_unread;  // workers that leave their messages unread
  std::vector<JobKey> changed;             // jobs whose state is new and must be journaled
  std::vector<JobKey> revised;             // jobs whose row must be journaled for another reason
  std::vector<std::pair<std::string, bool>> roster;  // worker ID; true: joined, false: gone
  std::vector<UnitName> audited;                     // units whose audit has ended
  std::vector<std::string> faulty_workers;  // workers whose committed units must be dropped
};

/// Why an active job is leased nothing.
enum class WaitReason : std::uint8_t {
  none,          // it is being rendered, or nothing of it is waiting
  budget,        // the budget of its owner or project is used up
  dependency,    // another job must make progress first
  no_workers,    // no worker at all
  no_pool,       // no worker in the pool
  no_tag,        // no worker in the pool with the required tag
  blocked,       // all workers in the pool with the tag are blocked for it
  restart,       // after a restart, workers that hold leases may come back
  limit,         // all units of a limit are in use
  priority,      // jobs of higher priority go first
  share,         // an owner that has used less goes first
  older_job,     // an older job of the same owner goes first
  other_worker,  // its waiting units failed; they wait for another worker
  farm_busy,     // all workers are busy
};

/// Decides which worker renders which unit: queue, leases, failures, audits
/// (docs/explanation/fault-tolerance.md).
///
/// A pure state machine without threads, locks, clock or files: callers pass `now`, serialise calls
/// and carry out the effects, so tests cover hours of timeouts in microseconds.
class Scheduler {
 public:
  struct Identity {
    std::string store_id, store_key;
    std::int64_t boot = 0;
  };
  /// Leases nothing until every worker of the roster is connected, or until policy.restart_grace
  /// after `start`.
  Scheduler(Identity identity, SchedulePolicy policy, const std::vector<std::string>& roster,
            Time start);

  // Jobs -----------------------------------------------------------------------------------------
  /// Adds a job from the journal. Requires a new key and ID.
  Job& add_job(JobKey key, std::shared_ptr<const JobSpec> spec, JobState state);
  Job* find_job(JobKey key);
  Job* find_job(const std::string& id);
  const Job* find_job(const std::string& id) const;
  const std::map<JobKey, Job>& jobs() const { return jobs_; }
  /// Counts a unit of the journal as committed, without effects.
  void restore_unit(Job& job, const contract::Unit& unit, const std::string& worker_id,
                    double cpu_seconds);
  /// Marks a frame of the journal finished, without effects. See JobPlan::finish().
  void restore_frame(Job& job, std::int32_t frame, std::optional<std::int64_t> unit_count = {});
  /// Counts a worker's share of frames that are finished.
  void restore_contribution(Job& job, const std::string& worker_id, const Contribution& done);
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
  /// Changes to a longer schedule; `spec` has the new settings. The caller restores finished
  /// frames.
  void extend(Job& job, std::shared_ptr<const JobSpec> spec);
  /// Changes priority, requirements, limits, dependencies and blocked workers; `spec` has the new
  /// ones and the same settings. Units already leased are rendered, but for those that a blocked
  /// worker has not started.
  void change(Job& job, std::shared_ptr<const JobSpec> spec, Time now);
  /// Notes that a job was removed in this state, and fails the jobs that can never be leased for
  /// that reason. For jobs removed before a restart.
  void note_removed(const std::string& job_id, JobState state);
  /// Returns whether all dependencies can still be met. Errors: FailedPrecondition, a job that had
  /// to be DONE first was removed before it was.
  absl::Status check_possible(const Job& job) const;
  /// Leases waiting units to workers with credits. Call after add_job and extend.
  void offer_work(Time now) { dispatch_all(now); }
  /// Removes an ended job.
  void remove_job(JobKey key);
  /// Returns why the job is leased nothing. Cost: a few look-ups, whatever the number of jobs.
  WaitReason wait_reason(const Job& job) const;
  /// The same for users; "" for WaitReason::none.
  std::string wait_text(const Job& job) const;

  /// Sets the upper bound of the job's needs.
  void set_demand(Job& job, double store_bytes, double samples);
  /// Returns the sum over the owner's unfinished jobs. Cost: one look-up.
  Demand demand(const std::string& owner) const;

  // Limits ---------------------------------------------------------------------------------------
  /// Units of named limits, and how many are in use.
  const Limits& limits() const { return limited_.limits(); }
  void set_limit(const std::string& name, std::int64_t units, Time now);
  /// Returns whether the limit existed.
  bool remove_limit(const std::string& name, Time now);
  /// Stops leasing units of jobs of these accounts, and only of these, for these reasons. Audits
  /// continue.
  void stop_accounts(std::map<Account, std::string> reasons, Time now);

  // Fair share -----------------------------------------------------------------------------------
  /// Returns the decayed use of every owner, without units in flight, for restore_usage() after a
  /// restart; units in flight are charged again when their workers return.
  std::vector<UsageRow> usage(Time now) const;
  void restore_usage(const std::vector<UsageRow>& table, Time now) { queue_.restore(table, now); }

  // Workers --------------------------------------------------------------------------------------
  /// Starts a worker's new stream: adopts running and unacknowledged units under valid seals, and
  /// releases all others.
  WorkerKey connect(const Hello& hello, Time now);
  /// Notes that the worker's stream broke; the worker is lost after the timeout.
  void disconnect(WorkerKey key);
  /// Notes that a message arrived.
  void record_contact(WorkerKey key, Time now);
  void heartbeat(WorkerKey key, const std::vector<UnitName>& started, std::int64_t rss_bytes,
                 Time now);
  void grant_credits(WorkerKey key, std::int32_t count, Time now);
  /// Leases the worker nothing more; it finishes the units that it has.
  void begin_draining(WorkerKey key);
  /// The worker returned units that it had not started.
  void return_units(WorkerKey key, const std::vector<UnitName>& units, Time now);
  /// The worker failed to render `tile` of `lease`. Ignored without a valid seal, and for a unit
  /// that the worker does not hold.
  void fail_unit(WorkerKey key, const Lease& lease, std::int32_t tile, Failure failure,
                 absl::StatusCode code, Time now);
  void scene_loaded(WorkerKey key, const std::string& job_id, const SceneLoad& load);
  Worker* find_worker(WorkerKey worker);
  Worker* find_worker(const std::string& id);
  const std::map<WorkerKey, Worker>& workers() const { return workers_; }
  /// Number of workers and jobs visited so far. Tests of cost count these steps instead of time.
  std::int64_t step_count() const { return step_count_; }
  /// Returns unfinished jobs of which units were leased to workers with this certificate.
  std::set<JobKey> leased_jobs(const std::string& certificate) const;

  // Results --------------------------------------------------------------------------------------
  /// Returns whether `unit` under `lease` belongs to a job that still needs results.
  bool wants(const Job& job, const Lease& lease, const contract::Unit& unit) const;
  /// Records that a unit is durable and revokes its other leases.
  void commit(Job& job, const contract::Unit& unit, const std::string& worker_id,
              double cpu_seconds);
  /// A committed unit's block was damaged and dropped: renders it again.
  void redo(Job& job, const contract::Unit& unit);
  /// Adaptive plans: see JobPlan::reset_pass_targets().
  void reset_pass_targets(Job& job, std::int32_t frame);
  /// Adaptive plans: see JobPlan::set_pass_target().
  void set_pass_target(Job& job, std::int32_t frame, std::int32_t tile, std::int32_t pass_count,
                       bool is_final);
  /// The worker delivered a unit that needs no result; it no longer holds the unit.
  void release_duplicate(Job& job, const contract::Unit& unit, const std::string& worker_id);
  void acknowledge(WorkerKey key, Acknowledgement acknowledgement);
  /// The frame's image is durable; ends the job after its last frame.
  void finish_frame(Job& job, std::int32_t frame, Time now);

  // Audits ---------------------------------------------------------------------------------------
  /// Returns whether a unit that this worker delivered must be audited: it is the worker's first
  /// unit or drawn, and there is another worker.
  bool wants_audit(const Job& job, const contract::Unit& unit, const std::string& worker_id);
  /// Has others render a committed unit again. Idempotent.
  void open_audit(Job& job, const contract::Unit& unit, const std::string& worker_id,
                  const contract::Digest& committed);
  /// Returns whether the frame waits for audits.
  bool has_audits(const Job& job, std::int32_t frame) const;
  /// A worker's result of a unit.
  struct Result {
    std::string worker_id;
    contract::Digest digest;
  };
  /// Takes a further result of a committed unit under `lease`. Returns whether it answers an audit.
  /// A result that differs starts an audit, unless audits are off (audit_fraction 0).
  bool answer_audit(Job& job, const contract::Unit& unit, const Lease& lease, const Result& result,
                    const Result& committed, Time now);
  /// Returns whether the worker is quarantined for wrong pixels or banned; its further results are
  /// then obsolete.
  bool is_quarantined(const std::string& worker_id) const;

  // Operator commands ----------------------------------------------------------------------------
  /// Drains a worker. Returns whether it is connected.
  bool drain(const std::string& worker_id);
  /// Bans a worker, connected or not, and every worker with its certificate: releases their units
  /// to others; their further results are obsolete. Committed results stay. `name`: a worker ID, or
  /// a name of names_to_ban().
  void ban(const std::string& name);
  /// Returns the names under which a worker is banned: its ID and, if it has a certificate, that of
  /// its witness. They are journaled, and given to ban() after a restart.
  std::vector<std::string> names_to_ban(const std::string& worker_id) const;
  /// Lifts the ban or quarantine of a worker and of its certificate. Returns whether the worker is
  /// known or had one.
  bool allow(const std::string& worker_id, Time now);
  /// Moves a worker, present or not, to a pool; "": to the one that it names itself. It returns
  /// units that it has not started.
  void move(const std::string& worker_id, const std::string& pool, Time now);
  /// Sets a worker aside, present or not: it finishes the units that it has started, returns the
  /// others and is leased nothing.
  void set_aside(const std::string& worker_id, const std::string& reason, Time now);
  void bring_back(const std::string& worker_id, Time now);
  /// The decisions of operators that move() and set_aside() recorded.
  const Placement& placement() const { return placement_; }

  // Time -----------------------------------------------------------------------------------------
  /// Call about every `period`: expires silent workers, ends the restart grace, balances the last
  /// units.
  void tick(Time now, Duration period);
  /// Counts everything again and compares it with the indexes, for tests. Errors: Internal, the
  /// first difference.
  absl::Status verify() const;
  /// Returns the actions decided since the last call.
  Effects take_effects();

 private:
  using Names = std::set<std::string>;
  /// How the workers of a witness behave.
  struct Conduct {
    std::set<JobKey> failing_jobs;  // of which they failed units; none was delivered since
    std::int32_t disproved = 0;     // units that they failed and another witness rendered
  };

  void advance(Time now);
  static JobQueue::QueueKey queue_key(const Job& job);
  void take_limits(Job& job);
  void give_back_limits(Job& job);
  DependencyState state_of(const Dependency& dependency) const;
  bool is_frame_blocked(const Job& job, std::int32_t frame) const;
  void check_dependencies(Job& job);
  void check_dependents(const Job& job);
  void check_dependents(const Job& job, std::int32_t frame);
  std::string dependency_text(const Job& job) const;
  const std::string* stop_reason(const Job& job) const;
  absl::Status verify_limits() const;
  static bool is_full(const Job& job);
  void refresh(Job& job);
  void count_demand(const Job& job, int sign);
  void end_if_finished(Job& job, Time now);
  void set_state(Job& job, JobState state, const std::string& reason, Time now);

  void hold(Job& job, Worker& worker, const contract::Unit& unit, const Holder& holder);
  void remove_hold(Job& job, const contract::Unit& unit, const Holder& holder);
  bool release(Job& job, Worker& worker, const contract::Unit& unit);
  void lose_unit(Job& job, Worker& worker, const contract::Unit& unit, Time now);
  void mark_lost(Worker& worker, Time now);
  void forget(Worker& worker);
  void place(Worker& worker);
  void place_again(Worker& worker, Time now);
  void set_witness(Worker& worker, std::string witness);
  void forget_witness(Worker& worker);
  void adopt(Worker& worker, const Hello& hello, Time now);
  void release_unlisted(Worker& worker,
                        const std::map<std::pair<JobKey, contract::Unit>, Attempt>& listed,
                        Time now);
  void count(Worker& worker);
  void uncount(Worker& worker);
  void recount(Worker& worker);
  void update_idle(Worker& worker);
  void remember_scene(Worker& worker, const SceneKey& scene);
  void forget_scene(const Worker& worker, const SceneKey& scene);
  void wake(Worker& worker);
  void revoke(Worker& worker, const Job& job, const contract::Unit& unit);
  void revoke_units(Worker& worker, const Job& job);

  static bool holds(const Worker& worker, const Job& job, const contract::Unit& unit) {
    return worker.leased_units.count({job.key, unit}) > 0;
  }
  bool has_witness_beyond(const Job& job, const Names& asked) const;
  bool has_unblocked_witness(const Job& job, const std::string& witness) const;
  bool has_others(const Job& job, const Names& asked) const;
  Names failed_witnesses(const Job& job, const contract::Unit& unit) const;
  bool stops_job(const Job& job, const contract::Unit& unit) const;
  static void list_attempts(Job& job, const contract::Unit& unit);
  void pause_for_failures(Job& job, const contract::Unit& unit, const absl::Status& failure,
                          Time now);
  void note_failing(Worker& worker, Job& job, Time now);
  void forgive(Job& job);
  void disprove(const Names& failed, const std::string& witness);
  void disprove_failures(Job& job, const contract::Unit& unit, const std::string& witness);
  void quarantine_witness(const std::string& witness, std::optional<Time> until);
  void end_quarantine(const std::string& witness);
  void end_timed_quarantines(Time now);

  bool could_audit(const Worker& worker, const Job& job) const;
  bool has_others(const Job& job, const Audit& audit) const;
  std::string witness_of(const std::string& worker_id) const;
  bool may_audit(const Worker& worker, const Job& job, const Audit& audit) const;
  void await_worker(Job& job, const contract::Unit& unit, Audit& audit);
  void stop_waiting(Job& job, const contract::Unit& unit, Audit& audit);
  bool lease_audit(Worker& worker);
  bool lease_audit_of(const AuditQueue::Groups& groups, Worker& worker);
  void lease_audit(Job& job, const contract::Unit& audited, Audit& audit, Worker& worker);
  bool release_audit(Job& job, Worker& worker, const contract::Unit& unit);
  void end_audit(Job& job, const contract::Unit& unit, Time now);
  void take_from_holder(Job& job, const contract::Unit& unit, const Audit& audit);
  bool has_candidate(const Job& job, const Audit& audit) const;
  void quarantine(const std::string& worker_id);
  void exclude(Worker& worker);
  void drop_audits(Job& job);
  std::vector<AuditQueue::Key> unresolvable(const std::set<AuditQueue::Key>& group, Time now);
  void fail_unresolvable_audits(Time now);

  bool has_work() const;
  bool may_work_for(const Worker& worker, const Job& job) const;
  bool may_take(const Worker& worker, const Job& job, const contract::Unit& unit) const;
  static bool has_scene(const Worker& worker, const Job& job);
  bool has_enough_workers(const Job& job) const;
  bool precedes(const Job& job, const Job& other) const;
  JobKey next_full_job(const Worker& worker, const std::function<bool(JobKey)>& may) const;
  JobKey next_job(const Worker& worker, const std::function<bool(JobKey)>& may);
  absl::Status verify_job(const Job& job) const;
  absl::Status verify_worker(const Worker& worker) const;
  JobKey choose_job(const Worker& worker, const std::set<JobKey>& refused);
  std::int32_t run_length(const Job& job, const Worker& worker) const;
  bool lease_run(Job& job, Worker& worker, Time now);
  Lease make_lease(const Job& job, const Worker& worker, const Run& run);
  void send_lease(Worker& worker, const Lease& lease);
  void lease(Job& job, Worker& worker, const Run& run, Time now);
  bool dispatch_one(Worker& worker, Time now);
  void dispatch(Worker& worker, Time now);
  std::vector<Worker*> workers_by_load_and_scene();
  void dispatch_all(Time now);
  std::vector<Worker*> idle_workers();
  void balance_tail(Time now);
  void copy_slow_units(std::vector<Worker*>& idle, Time now);
  void steal_unstarted(std::int32_t wanted);

  const Identity identity_;
  const SchedulePolicy policy_;
  std::map<JobKey, Job> jobs_;
  std::map<std::string, JobKey> job_by_id_;
  std::set<JobKey> tail_;    // running, without waiting units
  std::set<JobKey> queued_;  // jobs in queue_
  std::set<JobKey> full_;    // with waiting units and their maximum of workers: not in queue_, as
                             // only their present workers may take more
  JobQueue queue_;
  Dependencies dependencies_;
  LimitedQueues limited_;
  Placement placement_;
  std::map<Account, std::string> stopped_;  // reasons
  std::map<std::string, Demand> demands_;   // of unfinished jobs, by owner
  std::map<WorkerKey, Worker> workers_;
  std::map<std::string, WorkerKey> worker_by_id_;
  std::map<std::string, std::set<WorkerKey>> workers_by_witness_;
  std::map<SceneKey, std::set<WorkerKey>> workers_by_scene_;  // that have loaded it
  std::map<std::string, Conduct> conduct_;                    // by witness
  AuditQueue waiting_audits_;                                 // without a holder
  std::set<std::string> quarantined_;                         // IDs and witnesses: faulty or banned
  FarmCensus working_;                                        // of working workers
  FarmCensus present_;                           // the same and those whose stream has just broken
  std::set<std::pair<double, WorkerKey>> idle_;  // working, with credits: by load
  std::map<std::string, std::int32_t> idle_tags_;  // workers of idle_, by tag; "": all
  std::set<WorkerKey> timed_quarantines_;          // for a time
  std::set<std::string> missing_workers_;          // of the roster, not connected yet
  Time grace_ends_;
  Time now_;  // latest time given by a caller
  Time last_advance_;
  std::optional<Time> last_tick_;
  std::int64_t last_attempt_ = 0;
  WorkerKey last_worker_ = 0;
  std::int64_t step_count_ = 0;
  bool work_appeared_ = false;  // since the last dispatch_all
  std::set<WorkerKey> to_wake_;
  Effects effects_;
};

}  // namespace tessera::server
