#include "server/schedule/queue/ready_jobs.h"

#include <algorithm>

namespace tessera::server {
namespace {

void note(std::set<JobKey>& jobs, JobKey job, bool belongs) {
  if (belongs) {
    jobs.insert(job);
  } else {
    jobs.erase(job);
  }
}

}  // namespace

ReadyJobs::ReadyJobs(const SharePolicy& policy, const FarmCensus& working, Time start)
    : working_(working), queue_(policy, start), now_(start), last_advance_(start) {}

void ReadyJobs::advance(Time now) {
  constexpr std::chrono::minutes kPeriod{1};
  now_ = std::max(now_, now);
  if (now_ - last_advance_ < kPeriod) return;
  last_advance_ = now_;
  queue_.advance(now_);
}

JobQueue::QueueKey ReadyJobs::key_of(const Job& job) {
  return {job.spec->priority, job.spec->owner, job.scene,
          LimitedQueues::name(job.requirement, job.spec->limits)};
}

bool ReadyJobs::has_all_workers(const Job& job) {
  const std::int32_t limit = job.spec->max_workers;
  return limit > 0 && static_cast<std::int32_t>(job.holders.size()) >= limit;
}

void ReadyJobs::refresh(Job& job) {
  const bool is_runnable = job.is_runnable();
  const bool belongs_in_queue = is_runnable && !has_all_workers(job);
  if (!belongs_in_queue) {
    take_out(job);
  } else if (!is_queued(job.key)) {
    queued_.insert(job.key);
    queue_.insert(job.key, key_of(job), now_, working_.threads(job.requirement));
    limited_.count(job.requirement, job.spec->limits, 1);
  }
  note(full_, job.key, is_runnable && !belongs_in_queue);
  note(tail_, job.key,
       job.state == JobState::running && !is_runnable && !job.is_over_budget && job.plan &&
           job.plan->counts().in_flight > 0);
  if (is_runnable) note_work();
  if (!is_runnable || !job.holders.empty()) {
    job.waiting_since.reset();
  } else if (!job.waiting_since) {
    job.waiting_since = now_;
  }
}

void ReadyJobs::take_out(const Job& job) {
  if (queued_.erase(job.key) == 0) return;
  queue_.erase(job.key, key_of(job));
  limited_.count(job.requirement, job.spec->limits, -1);
}

void ReadyJobs::take_limits(Job& job) {
  ++job.lease_count;
  limited_.limits().take(job.spec->limits, 1);
}

void ReadyJobs::give_back_limits(Job& job) {
  --job.lease_count;
  if (job.spec->limits.empty()) return;
  limited_.limits().take(job.spec->limits, -1);
  note_work();
}

}  // namespace tessera::server
