// Why a job is leased nothing, for its owner.
#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

WaitReason Scheduler::wait_reason(const Job& job) const {
  if (job.state != JobState::queued && job.state != JobState::running) return WaitReason::none;
  const std::string& tag = job.spec->required_tag;
  if (present_.find("") == nullptr) return WaitReason::no_workers;
  if (present_.find(tag) == nullptr) return WaitReason::no_tag;
  if (!job.is_runnable() || !job.holders.empty()) return WaitReason::none;
  if (!missing_workers_.empty() && now_ < grace_ends_) return WaitReason::restart;
  const JobQueue::QueueKey key = queue_key(job);
  if (queue_.is_outranked(key)) return WaitReason::priority;
  if (!job.unit_failures.empty() && idle_tags_.count(tag) > 0) return WaitReason::other_worker;
  // A job that has begun waits like this between any two leases.
  if (job.state == JobState::running) return WaitReason::none;
  if (queue_.is_beyond_share(key)) return WaitReason::share;
  if (queue_.oldest_of(key) != job.key) return WaitReason::older_job;
  return WaitReason::farm_busy;
}

std::string Scheduler::wait_text(const Job& job) const {
  switch (wait_reason(job)) {
    case WaitReason::none:
      break;
    case WaitReason::no_workers:
      return "no workers connected";
    case WaitReason::no_tag:
      return absl::StrCat("no connected worker has tag ", job.spec->required_tag);
    case WaitReason::restart:
      return "workers may reconnect after the server's restart";
    case WaitReason::priority:
      return "jobs of higher priority go first";
    case WaitReason::share:
      return "another client has used less and goes first";
    case WaitReason::older_job:
      return "an older job of the same client goes first";
    case WaitReason::other_worker:
      return "its failed units wait for another worker";
    case WaitReason::farm_busy:
      return "all workers are busy";
  }
  return "";
}

}  // namespace tessera::server
