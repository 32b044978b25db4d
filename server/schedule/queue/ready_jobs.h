#pragma once

#include <set>

#include "server/schedule/plan/job.h"
#include "server/schedule/queue/job_queue.h"
#include "server/schedule/queue/limited_queues.h"
#include "server/schedule/workers/farm_census.h"

namespace tessera::server {

/// Active jobs by what may be leased of them: those in the queue, those that have their maximum of
/// workers, and those without waiting units. Pure; it keeps the latest time given by a caller.
class ReadyJobs {
 public:
  /// `working`: the working workers, which must outlive this object.
  ReadyJobs(const SharePolicy& policy, const FarmCensus& working, Time start);

  /// Notes the time. Call first in every function that is given one.
  void advance(Time now);
  /// Returns the latest time given by a caller.
  Time now() const { return now_; }

  /// Brings the indexes up to date. Call after the job's state, its units or their holders have
  /// changed.
  void refresh(Job& job);
  /// Takes the job out of the queue. Call before its settings change, and refresh() afterwards.
  void take_out(const Job& job);
  bool is_queued(JobKey job) const { return queued_.count(job) > 0; }
  std::size_t queued_count() const { return queued_.size(); }
  /// Jobs with waiting units and their maximum of workers: not in the queue, as only their present
  /// workers may take more.
  const std::set<JobKey>& full() const { return full_; }
  /// Running jobs without waiting units.
  const std::set<JobKey>& tail() const { return tail_; }
  JobQueue& queue() { return queue_; }
  const JobQueue& queue() const { return queue_; }
  LimitedQueues& limited() { return limited_; }
  const LimitedQueues& limited() const { return limited_; }

  /// Counts a lease of the job against its limits.
  void take_limits(Job& job);
  /// The reverse.
  void give_back_limits(Job& job);

  /// Notes that units may be leased that could not be before.
  void note_work() { has_new_work_ = true; }
  bool has_new_work() const { return has_new_work_; }
  void set_new_work(bool has_new_work) { has_new_work_ = has_new_work; }

  static JobQueue::QueueKey key_of(const Job& job);
  /// Returns whether the job has its maximum of workers.
  static bool has_all_workers(const Job& job);

 private:
  const FarmCensus& working_;
  JobQueue queue_;
  LimitedQueues limited_;
  std::set<JobKey> queued_;  // in queue_
  std::set<JobKey> full_;
  std::set<JobKey> tail_;
  Time now_;
  Time last_advance_;
  bool has_new_work_ = false;
};

}  // namespace tessera::server
