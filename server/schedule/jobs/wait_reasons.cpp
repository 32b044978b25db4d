#include "server/schedule/jobs/wait_reasons.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {

namespace {

std::string limit_text(const Limits& limits, const JobSpec& spec) {
  for (const LimitUse& use : spec.limits) {
    if (limits.room({use}) > 0) continue;
    const Limits::Limit& limit = limits.all().at(use.limit);
    if (*limit.units > 0 && use.units > *limit.units) {
      return absl::StrCat("limit ", use.limit, " has ", *limit.units,
                          *limit.units == 1 ? " unit" : " units", ", a lease needs ", use.units,
                          "; `tessera limits set` raises the limit, `tessera set ", spec.id,
                          " --limit` changes the job");
    }
    return absl::StrCat("limit ", use.limit, " is reached: ", limit.used, " of ", *limit.units,
                        " units are in use, a lease needs ", use.units);
  }
  return "";
}

}  // namespace

WaitReason WaitReasons::wait_reason(const Job& job) const {
  if (job.state != JobState::queued && job.state != JobState::running) return WaitReason::none;
  if (job.is_over_budget) return WaitReason::budget;
  const bool is_blocked = job.is_blocked || !job.blocked_frames.empty();
  if (is_blocked && !job.is_runnable() && job.holders.empty()) return WaitReason::dependency;
  if (counts_.present().find("") == nullptr) return WaitReason::no_workers;
  const std::string& tag = job.requirement;
  if (counts_.present().find(requirement(job.spec->pool, "")) == nullptr)
    return WaitReason::no_pool;
  if (counts_.present().find(tag) == nullptr) return WaitReason::no_tag;
  if (!witnesses_.has_witness_beyond(job, {})) {
    return job.lost_asset.empty() ? WaitReason::blocked : WaitReason::lost_asset;
  }
  if (!job.is_runnable() || !job.holders.empty()) return WaitReason::none;
  if (absences_.is_grace(ready_.now())) return WaitReason::restart;
  if (ready_.limited().limits().room(job.spec->limits) == 0) return WaitReason::limit;
  const JobQueue::QueueKey key = ReadyJobs::key_of(job);
  if (ready_.queue().is_outranked(key)) return WaitReason::priority;
  if (!job.unit_failures.empty() && counts_.idle_tags().count(tag) > 0)
    return WaitReason::other_worker;
  // A job that has begun waits like this between any two leases.
  if (job.state == JobState::running) return WaitReason::none;
  if (ready_.queue().is_beyond_share(key)) return WaitReason::share;
  if (ready_.queue().oldest_of(key) != job.key) return WaitReason::older_job;
  return WaitReason::farm_busy;
}

std::string WaitReasons::wait_text(const Job& job) const {
  const std::string pool = job.spec->pool.empty() ? kDefaultPool : job.spec->pool;
  switch (wait_reason(job)) {
    case WaitReason::none:
      break;
    case WaitReason::budget:
      return *stopped_.reason_for(job);
    case WaitReason::blocked:
      return absl::StrCat("all connected workers that could render it are blocked for it; ",
                          "`tessera workers unblock WORKER --job ", job.spec->id, "` unblocks one");
    case WaitReason::lost_asset:
      return absl::StrCat("the store has lost its scene file ", job.lost_asset,
                          "; submit the scene again");
    case WaitReason::no_workers:
      return "no workers connected";
    case WaitReason::dependency:
      return checks_.dependency_text(job);
    case WaitReason::no_pool:
      return absl::StrCat("no connected worker is in pool ", pool);
    case WaitReason::no_tag:
      return absl::StrCat("no connected worker", pool == kDefaultPool ? "" : " of pool " + pool,
                          " has tag ", job.spec->required_tag);
    case WaitReason::limit:
      return limit_text(ready_.limited().limits(), *job.spec);
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
