#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

/// Random numbers that are the same on every machine (SplitMix64, Steele et al. 2014).
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next();
  /// A number in [0, count).
  int below(int count) { return static_cast<int>(next() % static_cast<std::uint64_t>(count)); }
  bool one_in(int count) { return below(count) == 0; }

 private:
  std::uint64_t state_;
};

/// A farm in one thread and simulated time: the scheduler, a model of the store, and workers that
/// join, leave, crash, lie, fail, and deliver late or twice. Everything follows from the seed.
///
/// One certificate is faulty. Two honest workers stay, so no job may fail or be paused by failures.
/// run() checks after each step that the scheduler's indexes match a recount, that no committed
/// unit is leased again but for an audit, that no unit is leased before the jobs that its own waits
/// for, to a worker that is set aside or blocked for its job, or while its owner's budget is used
/// up, that no limit is exceeded but by units that workers brought back, and at the end that every
/// job is done and no worker holds units. fair_share_test.cpp tests the shares of owners.
class SimulatedFarm {
 public:
  explicit SimulatedFarm(std::uint64_t seed);
  ~SimulatedFarm();

  /// Runs the chaos and then, without faults, until all jobs are done. Returns the first violation,
  /// "" if there is none.
  std::string run();
  /// Counts of events and faults, so that a test can see that faults take place.
  struct Events {
    int commits = 0, duplicates = 0, audits = 0, restarts = 0, crashes = 0, failures = 0, lies = 0,
        redone = 0, quarantines = 0, late_ticks = 0, lost_writes = 0, removals = 0, impossible = 0,
        moves = 0, full_limits = 0, asides = 0, blocks = 0, stops = 0;
  };
  const Events& events() const { return events_; }

 private:
  struct Task;
  struct Computer;
  struct Stored;
  struct StoredUnit;
  struct Write;

  void violate(const std::string& what);
  void start_scheduler();
  void restart_server();
  void add_job();
  void add_dependencies(JobSpec& spec);
  void remove_job(JobKey key);
  void change_job(Job& job);
  Attempt newest_lease() const;
  void toggle_block(JobKey key, JobSpec& spec);
  void toggle_aside();
  void toggle_stop();
  void check_lease(const Computer& computer, const Job& job, const Lease& lease);
  void retry(Job& job);
  void resume_all();
  bool is_met(const Dependency& dependency, const Lease& lease) const;
  void check_limits();
  Computer& add_computer(const std::string& certificate, bool is_faulty, bool is_anchor);
  void connect(Computer& computer);
  void lose_stream(Computer& computer);
  void step(bool is_calm);
  void disturb();
  void disturb_jobs();
  void work(Computer& computer, bool is_calm);
  void read_mail(Computer& computer);
  void take_lease(Computer& computer, const Lease& lease);
  void return_revoked(Computer& computer, const std::vector<UnitName>& revoked);
  void finish(Computer& computer, Task& task, bool is_calm);
  void deliver(const std::string& worker_id, const Task& task);
  void commit(const Write& write);
  bool answer_duplicate(Job& job, const Write& write);
  void acknowledge(const std::string& worker_id, const UnitName& name, AckStatus status);
  void run_disk();
  void apply_effects();
  void redo_units(const std::string& worker_id);
  void finish_frames(Job& job);
  void check();
  std::string check_end();

  Dice dice_;
  SchedulePolicy policy_;
  Time now_;
  std::int64_t boot_ = 0;
  std::unique_ptr<Scheduler> scheduler_;
  std::map<std::string, std::unique_ptr<Computer>> computers_;  // by worker ID
  std::map<JobKey, std::unique_ptr<Stored>> store_;
  std::map<std::string, JobState> removed_;   // by job ID
  std::int64_t limit_ = 0;                    // units of the only limit
  std::int64_t excess_ = 0;                   // its use that workers brought back, or more
  std::map<std::string, std::string> moved_;  // pool, by worker ID
  std::set<std::string> aside_;               // worker IDs
  std::map<Account, std::string> stopped_;
  Attempt last_lease_;  // newest that a worker has read
  // The newest lease when a worker was set aside, blocked for a job, an account stopped, a job
  // retried.
  std::map<std::string, Attempt> aside_since_;
  std::map<std::pair<JobKey, std::string>, Attempt> blocked_since_;
  std::map<Account, Attempt> stopped_since_;
  std::map<std::string, Attempt> retried_since_;  // by job ID
  std::set<std::string> bans_, roster_;
  std::vector<UsageRow> usage_;
  std::vector<Write> writes_;  // delivered, not durable
  JobKey last_job_ = 0;
  int last_computer_ = 0;
  Events events_;
  std::string violation_;
};

}  // namespace tessera::server
