#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "server/schedule/job.h"
#include "server/schedule/job_queue.h"
#include "server/schedule/worker.h"

namespace tessera::server {

/// The constants of farm.md, sections 2 and 3.
struct SchedulePolicy {
  Duration worker_timeout = std::chrono::seconds(5);  // after which a worker is lost
  Duration restart_grace = std::chrono::seconds(5);   // grants wait so long for known workers
  Duration timer_slack = std::chrono::seconds(1);     // a tick later than this extends every lease
  Duration forget_after = std::chrono::hours(1);      // lost workers are listed so long
  std::int32_t failure_limit = 3;                     // the failure of a unit that fails its job
  std::int32_t loss_limit = 10;                       // losses of a unit a job survives
  std::int32_t disproved_limit = 3;  // failures, disproved elsewhere, a worker may have
  Duration audit_timeout = std::chrono::minutes(1);  // a dispute waits so long for other workers
  double audit_fraction = 0.01;                      // of units that another worker renders again
  double load_factor = 10;  // a worker works this many load times before it changes job
};

/// What the scheduler has decided and the rim has to carry out.
struct Effects {
  std::vector<WorkerKey> to_wake;   // workers with mail
  std::vector<WorkerKey> to_close;  // lost workers whose stream, if any, is to be closed
  std::vector<JobKey> changed;      // jobs whose row is to be journaled
  std::vector<std::pair<std::string, bool>> roster;  // worker id; true: joined, false: gone
  std::vector<UnitName> audited;                     // whose audits are over
  std::vector<std::string> faulty_workers;           // workers whose committed units are to go
};

/// Who renders what: the queue, the leases, the failures (farm.md, sections 2 to 4).
///
/// A pure state machine. It owns no thread, lock, clock or file: callers pass `now`, serialise the
/// calls, and carry out the effects, so a test can walk hours of expiry in microseconds.
class Scheduler {
 public:
  struct Identity {
    std::string store_id, store_key;
    std::int64_t boot = 0;
  };
  /// Grants nothing until every worker of the roster is back, or policy.restart_grace after
  /// `start`.
  Scheduler(Identity identity, SchedulePolicy policy, const std::vector<std::string>& roster,
            Time start);

  // Jobs -----------------------------------------------------------------------------------------
  /// Adds a job as the journal has it. Requires a new key and id.
  Job& add_job(JobKey key, std::shared_ptr<const JobSpec> spec, JobState state);
  Job* find_job(JobKey key);
  Job* find_job(const std::string& id);
  const Job* find_job(const std::string& id) const;
  const std::map<JobKey, Job>& jobs() const { return jobs_; }
  /// Counts a unit of the journal as committed, without any effect.
  void restore_unit(Job& job, const contract::Unit& unit, const std::string& worker_id,
                    double cpu_seconds);
  /// Counts what a worker did for a job, of units whose frames are finished.
  void restore_contribution(Job& job, const std::string& worker_id, const Contribution& done);
  /// Leases nothing new of it. Errors: FailedPrecondition, it has ended.
  absl::Status pause(Job& job, const std::string& reason, Time now);
  absl::Status resume(Job& job, Time now);
  /// Errors: FailedPrecondition, it is done or failed.
  absl::Status cancel(Job& job, Time now);
  /// Goes on with a failed or cancelled job, failure counts zero. Errors: FailedPrecondition, done.
  absl::Status retry(Job& job, Time now);
  /// Ends the job: revokes its leases, tells every worker that had any.
  void end_job(Job& job, JobState state, const std::string& reason, Time now);
  /// Ends the job as failed, with the code and message of `failure`. Ignored if it has ended.
  void fail_job(Job& job, const absl::Status& failure, Time now);
  /// Goes on with a longer schedule; `spec` has the new count. The caller restores finished frames.
  void extend(Job& job, std::shared_ptr<const JobSpec> spec);
  /// Leases what is waiting to workers with room. After add_job and extend.
  void offer_work(Time now) { dispatch_all(now); }
  /// Forgets an ended job.
  void remove_job(JobKey key);

  // Workers --------------------------------------------------------------------------------------
  /// A worker's new stream: adopts the units it runs or holds under our seal, takes back others.
  WorkerKey connect(const Hello& hello, Time now);
  /// Its stream broke; it is lost once the silence has lasted.
  void disconnect(WorkerKey key);
  /// A sign of life.
  void record_contact(WorkerKey key, Time now);
  void heartbeat(WorkerKey key, const std::vector<UnitName>& started, std::int64_t rss_bytes,
                 Time now);
  void grant_credits(WorkerKey key, std::int32_t count, Time now);
  /// The worker takes nothing more; what it has it finishes.
  void begin_draining(WorkerKey key);
  /// It handed units back that it had not started.
  void return_units(WorkerKey key, const std::vector<UnitName>& units, Time now);
  /// It failed to render `tile` of `lease`. Ignored without our seal.
  void fail_unit(WorkerKey key, const Lease& lease, std::int32_t tile, Failure failure,
                 absl::StatusCode code, Time now);
  void scene_loaded(WorkerKey key, const std::string& job_id, double load_seconds,
                    double build_seconds, std::int64_t peak_rss_bytes);
  Worker* find_worker(WorkerKey worker);
  Worker* find_worker(const std::string& id);
  const std::map<WorkerKey, Worker>& workers() const { return workers_; }
  /// Jobs, not ended, of which workers with this certificate were leased units.
  std::set<JobKey> leased_jobs(const std::string& certificate) const;

  // Results --------------------------------------------------------------------------------------
  /// Whether `unit` under `lease` is a unit of a job that still wants results.
  bool wants(const Job& job, const Lease& lease, const contract::Unit& unit) const;
  /// A wanted unit has become durable: whoever else holds it is asked to hand it back.
  void commit(Job& job, const contract::Unit& unit, const std::string& worker_id,
              double cpu_seconds);
  /// A committed unit's block was found damaged and dropped: it is to be rendered again.
  void redo(Job& job, const contract::Unit& unit);
  /// In a plan on demand: what was wanted of the frame so far was decided on false results.
  void reset_pass_targets(Job& job, std::int32_t frame);
  /// In a plan on demand: the film has decided how many passes a tile wants
  /// (JobPlan::set_pass_target).
  void set_pass_target(Job& job, std::int32_t frame, std::int32_t tile, std::int32_t pass_count,
                       bool is_final);
  /// The unit came once more from this worker; it holds it no longer.
  void release_duplicate(Job& job, const contract::Unit& unit, const std::string& worker_id);
  void acknowledge(WorkerKey key, Acknowledgement acknowledgement);
  /// The frame's image is durable; ends the job after its last one.
  void finish_frame(Job& job, std::int32_t frame, Time now);

  // Audits (farm.md, section 8) ------------------------------------------------------------------
  /// Whether a unit that this worker has delivered is to be audited: the worker's first unit, or
  /// drawn, while there is another worker.
  bool wants_audit(const Job& job, const contract::Unit& unit, const std::string& worker_id);
  /// Has a committed unit rendered again by others. Harmless to repeat.
  void open_audit(Job& job, const contract::Unit& unit, const std::string& worker_id,
                  const contract::Digest& committed);
  /// Whether a frame is held up by audits.
  bool has_audits(const Job& job, std::int32_t frame) const;
  /// A worker's result of a unit.
  struct Result {
    std::string worker_id;
    contract::Digest digest;
  };
  /// A further result, under `lease`, of a unit that is committed: whether it was an answer to an
  /// audit. One that differs begins an audit, unless there are none (audit_fraction 0).
  bool answer_audit(Job& job, const contract::Unit& unit, const Lease& lease, const Result& result,
                    const Result& committed, Time now);
  /// Whether the worker was found lying or is banned: nothing of it is taken.
  bool is_quarantined(const std::string& worker_id) const {
    return quarantined_.count(worker_id) > 0;
  }

  // Orders ---------------------------------------------------------------------------------------
  /// Asks a worker to go. Returns whether it is connected.
  bool drain(const std::string& worker_id);
  /// Nothing more is leased to the worker or taken of it, whether it is here or not; what it holds,
  /// others render. What it delivered stays.
  void ban(const std::string& worker_id);
  /// Takes back that the worker was shut out or set aside. Returns whether either is known of it.
  bool allow(const std::string& worker_id, Time now);

  // Time -----------------------------------------------------------------------------------------
  /// Call about every `period`: expires silent workers, opens grants, balances the tail.
  void tick(Time now, Duration period);
  /// Takes what has been decided since the last call.
  Effects take_effects();

 private:
  void refresh(Job& job);
  void set_state(Job& job, JobState state, const std::string& reason, Time now);
  void charge(const Job& job, double cpu_seconds);

  void hold(Job& job, Worker& worker, const contract::Unit& unit, const Holder& holder);
  void forget_hold(Job& job, const contract::Unit& unit, const Holder& holder);
  bool release(Job& job, Worker& worker, const contract::Unit& unit);
  void lose_unit(Job& job, Worker& worker, const contract::Unit& unit, Time now);
  void lose(Worker& worker, Time now);
  void adopt(Worker& worker, const Hello& hello, Time now);
  void disprove(const UnitFailures& failures, const std::string& worker_id);
  void count_threads();
  void wake(Worker& worker) { to_wake_.insert(worker.key); }
  void revoke(Worker& worker, const Job& job, const contract::Unit& unit);

  static bool could_audit(const Worker& worker, const Job& job);
  bool has_others(const Job& job, const Audit& audit) const;
  bool may_audit(const Worker& worker, const Job& job, const Audit& audit) const;
  bool lease_audit(Worker& worker);
  bool release_audit(Job& job, Worker& worker, const contract::Unit& unit);
  void settle_audit(Job& job, const contract::Unit& unit, Time now);
  void quarantine(const std::string& worker_id);
  void forget_audits(Job& job);
  void fail_unresolvable_audits(Time now);

  bool has_work() const { return !queue_.empty() || !waiting_audits_.empty(); }
  bool may_work_for(const Worker& worker, const Job& job) const;
  bool may_take(const Worker& worker, const Job& job, const contract::Unit& unit) const;
  static bool has_scene(const Worker& worker, const Job& job);
  bool has_enough_workers(const Job& job) const;
  JobKey next_job(const Worker& worker, const std::function<bool(JobKey)>& may) const;
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
  std::set<JobKey> active_;  // running, with a plan
  std::set<JobKey> queued_;  // what queue_ holds
  JobQueue queue_;
  std::map<WorkerKey, Worker> workers_;
  std::map<std::string, WorkerKey> worker_by_id_;
  std::set<std::pair<JobKey, contract::Unit>> waiting_audits_;  // that nobody renders now
  std::set<std::string> quarantined_;                   // worker ids: found lying, or banned
  std::set<WorkerKey> workers_with_credits_;            // working, with credits
  std::map<std::string, std::int32_t> threads_;         // of working workers, by tag; "": all
  std::map<std::string, std::set<std::string>> hosts_;  // likewise
  std::set<std::string> missing_workers_;               // of the roster, not yet back
  Time grace_ends_;
  std::optional<Time> last_tick_;
  std::int64_t last_attempt_ = 0;
  WorkerKey last_worker_ = 0;
  bool work_appeared_ = false;  // since the last dispatch_all
  std::set<WorkerKey> to_wake_;
  Effects effects_;
};

}  // namespace tessera::server
