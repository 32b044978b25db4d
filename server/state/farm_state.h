#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "server/report/job_view.h"
#include "server/schedule/scheduler/scheduler.h"
#include "server/state/farm_options.h"
#include "server/state/job_film.h"
#include "server/state/job_index.h"
#include "server/state/kept_results.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"
#include "server/telemetry/event_log.h"
#include "telemetry/log/log.h"

namespace tessera::server {

class FarmChange;

/// A part of the server that carries out effects of the scheduler.
class EffectHandler {
 public:
  virtual ~EffectHandler() = default;
  /// Called at the end of a change, with the farm locked. Must not wait or use the disk.
  virtual void carry_out(FarmChange& change, const Effects& effects) = 0;
};

/// Workers, jobs, units and leases behind one lock. Its contents are only reached through a locked
/// section: FarmView to read, FarmChange to change. Functions that need the lock held take the
/// section as an argument.
///
/// Contains no gRPC: ThreadSanitizer cannot see into Debian's libgrpc, so the lock is below it,
/// where plain threads can test it. No disk operation runs in a section.
class FarmState {
 public:
  FarmState(const Store& store, FarmOptions options, const std::vector<std::string>& roster);

  /// Adds a part, called after those that were added before. Before any other thread exists.
  void add_handler(EffectHandler& handler) { handlers_.push_back(&handler); }

  const FarmOptions& options() const { return options_; }
  FarmMetrics& metrics() const { return *options_.metrics; }
  Time now() const { return options_.clock(); }
  /// Recent events; has a lock of its own.
  EventLog& events() { return events_; }
  const EventLog& events() const { return events_; }
  /// Writes a line to the server's log. Without the farm's lock: see FarmView::log.
  void log(LogLevel level, const std::string& message) const;

 private:
  friend class FarmView;
  friend class FarmChange;

  const FarmOptions options_;
  EventLog events_;
  std::vector<EffectHandler*> handlers_;

  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kFarm)
      ABSL_ACQUIRED_BEFORE(lock_order::kPart){lock_order::kFarm};
  Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  std::map<JobKey, JobFilm> films_ ABSL_GUARDED_BY(mutex_);
  JobIndex index_ ABSL_GUARDED_BY(mutex_);
  KeptResults kept_ ABSL_GUARDED_BY(mutex_);
  std::set<std::pair<std::int64_t, JobKey>> ended_ ABSL_GUARDED_BY(mutex_);  // by end_served_us
  const Time opened_;
  std::int64_t served_us_before_ ABSL_GUARDED_BY(mutex_) = 0;  // by earlier servers
};

/// A locked section that reads the farm's state.
class ABSL_SCOPED_LOCKABLE FarmView {
 public:
  explicit FarmView(const FarmState& farm) ABSL_EXCLUSIVE_LOCK_FUNCTION(farm.mutex_);
  /// Unlocks, then makes the deferred calls.
  ~FarmView() ABSL_UNLOCK_FUNCTION();
  FarmView(const FarmView&) = delete;
  FarmView& operator=(const FarmView&) = delete;

  Time now() const { return farm_.now(); }
  /// Time for which this server and earlier ones of its store have run, µs. Ended jobs age by it,
  /// because no jump of the wall clock changes it, not even one between two servers.
  std::int64_t served_us() const ABSL_NO_THREAD_SAFETY_ANALYSIS {
    const std::chrono::microseconds here =
        std::chrono::duration_cast<std::chrono::microseconds>(now() - farm_.opened_);
    return farm_.served_us_before_ + here.count();
  }
  const Scheduler& scheduler() const ABSL_NO_THREAD_SAFETY_ANALYSIS { return farm_.scheduler_; }
  const JobIndex& index() const ABSL_NO_THREAD_SAFETY_ANALYSIS { return farm_.index_; }
  /// Returns nullptr if there is no such job.
  const Job* find_job(const std::string& job_id) const;
  const JobFilm& film(const Job& job) const;
  /// Returns a snapshot for clients.
  JobView view(const Job& job) const;
  static PauseCause pause_cause(const Job& job);
  /// Returns the job's row.
  JobRecord record(const Job& job) const;
  const FarmOptions& options() const { return farm_.options(); }
  /// Returns what the owner's jobs use of its quotas; scene files are not in it.
  OwnerUse owner_use(const std::string& owner) const;
  /// Ended jobs by the time of service at their end (JobFilm::end_served_us).
  const std::set<std::pair<std::int64_t, JobKey>>& ended_jobs() const
      ABSL_NO_THREAD_SAFETY_ANALYSIS {
    return farm_.ended_;
  }
  /// Returns what an ended job keeps on disk; 0 for another.
  std::int64_t kept_bytes(const Job& job) const ABSL_NO_THREAD_SAFETY_ANALYSIS {
    return farm_.kept_.of_job(job.key);
  }

  /// Makes a call after unlocking: it may wait, or take this lock.
  void after_unlocking(std::function<void()> call) { calls_.push_back(std::move(call)); }
  /// Writes a line to the server's log after unlocking.
  void log(LogLevel level, std::string message);

 private:
  const FarmState& farm_;
  std::vector<std::function<void()>> calls_;
};

/// A locked section that changes the farm's state. At its end the parts carry out what the
/// scheduler decided; no section can leave that out.
class ABSL_SCOPED_LOCKABLE FarmChange : public FarmView {
 public:
  explicit FarmChange(FarmState& farm) ABSL_EXCLUSIVE_LOCK_FUNCTION(farm.mutex_);
  ~FarmChange() ABSL_UNLOCK_FUNCTION();
  FarmChange(const FarmChange&) = delete;
  FarmChange& operator=(const FarmChange&) = delete;

  Scheduler& scheduler() ABSL_NO_THREAD_SAFETY_ANALYSIS { return state_.scheduler_; }
  /// Adds the time for which earlier servers have run to served_us().
  void continue_service(std::int64_t served_us) ABSL_NO_THREAD_SAFETY_ANALYSIS {
    state_.served_us_before_ = served_us;
  }
  using FarmView::find_job;
  Job* find_job(const std::string& job_id);
  using FarmView::film;
  JobFilm& film(const Job& job);
  /// Sets JobFilm::end_served_us.
  void set_end_served(const Job& job, std::optional<std::int64_t> served_us);
  Job& add_job(JobKey key, std::shared_ptr<const JobSpec> spec, JobState state);
  /// Tells the scheduler what a job with new settings may need at most, for its owner's quota.
  void note_demand(Job& job);
  /// Counts what an ended job keeps on disk for its owner's quota.
  void note_kept(const Job& job);
  /// Forgets an ended job.
  void remove_job(const Job& job);
  /// Pauses a job because the disk is full. Does nothing for an ended or paused job.
  void pause_for_room(Job& job, const absl::Status& status);
  /// Returns whether a job was paused by pause_for_room(), also by an earlier server.
  static bool waits_for_room(const Job& job);

  // Events.
  void note(EventKind kind, const Job& job, const std::string& worker_id, const std::string& text);
  void note(EventKind kind, const std::string& worker_id, const std::string& text);

 private:
  void settle();
  void note_state(const Job& job);

  FarmState& state_;
};

}  // namespace tessera::server
