// Limits: how many leases may use a licence or another named resource at once.
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

/// Returns the name of the job's part of the queue. Jobs with the same requirement and the same
/// limits share one, so that none of them is looked at while a limit is reached.
std::string Scheduler::queue_name(const Job& job) {
  std::string name = job.requirement;
  for (const LimitUse& use : job.spec->limits) {
    absl::StrAppend(&name, "\n", use.limit, "=", use.units);
  }
  return name;
}

/// Returns the parts of the queue whose jobs the worker could be leased now.
Scheduler::Names Scheduler::queues_for(const Worker& worker) const {
  Names queues = worker.serves;
  for (const auto& [name, queue] : limited_) {
    if (worker.serves.count(queue.requirement) > 0 && limits_.room(queue.limits) > 0) {
      queues.insert(name);
    }
  }
  return queues;
}

/// Call when the job enters or leaves the queue.
void Scheduler::count_limited(const Job& job, int sign) {
  if (job.spec->limits.empty()) return;
  const std::string name = queue_name(job);
  LimitedQueue& queue = limited_[name];
  queue.requirement = job.requirement;
  queue.limits = job.spec->limits;
  queue.jobs += sign;
  if (queue.jobs == 0) limited_.erase(name);
}

/// Returns whether a worker with credits could be leased a job with limits.
bool Scheduler::has_limited_work() const {
  return std::any_of(limited_.begin(), limited_.end(), [this](const auto& entry) {
    const LimitedQueue& queue = entry.second;
    return idle_tags_.count(queue.requirement) > 0 && limits_.room(queue.limits) > 0;
  });
}

void Scheduler::take_limits(Job& job) {
  ++job.lease_count;
  limits_.take(job.spec->limits, 1);
}

void Scheduler::give_back_limits(Job& job) {
  --job.lease_count;
  if (job.spec->limits.empty()) return;
  limits_.take(job.spec->limits, -1);
  work_appeared_ = true;
}

void Scheduler::set_limit(const std::string& name, std::int64_t units, Time now) {
  advance(now);
  limits_.set(name, units);
  work_appeared_ = true;
  dispatch_all(now);
}

bool Scheduler::remove_limit(const std::string& name, Time now) {
  advance(now);
  const bool existed = limits_.remove(name);
  work_appeared_ = true;
  dispatch_all(now);
  return existed;
}

void Scheduler::change(Job& job, std::shared_ptr<const JobSpec> spec, Time now) {
  advance(now);
  for (auto& [unit, audit] : job.audits) stop_waiting(job, unit, audit);
  if (queued_.erase(job.key) > 0) {
    queue_.erase(job.key, queue_key(job));
    count_limited(job, -1);
  }
  limits_.take(job.spec->limits, -job.lease_count);
  dependencies_.replace(job.key, job.spec->after, spec->after);
  job.spec = std::move(spec);
  job.requirement = job.spec->requirement();
  limits_.take(job.spec->limits, job.lease_count);
  for (auto& [unit, audit] : job.audits) {
    if (!audit.holder) await_worker(job, unit, audit);
  }
  check_dependencies(job);
  refresh(job);
  dispatch_all(now);
}

absl::Status Scheduler::verify_limits() const {
  std::map<std::string, std::int64_t> used, queued;
  for (const auto& [key, job] : jobs_) {
    std::int64_t leases = 0;
    for (const auto& [worker, units] : job.holders) leases += units;
    for (const auto& [unit, audit] : job.audits) leases += audit.holder ? 1 : 0;
    if (leases != job.lease_count) {
      return absl::InternalError(absl::StrCat("scheduler: leases of job ", job.spec->id));
    }
    for (const LimitUse& use : job.spec->limits) used[use.limit] += leases * use.units;
    if (!job.spec->limits.empty() && queued_.count(key) > 0) ++queued[queue_name(job)];
  }
  for (const auto& [name, limit] : limits_.all()) {
    if (limit.used != used[name]) return absl::InternalError("scheduler: use of limit " + name);
    used.erase(name);
  }
  for (const auto& [name, units] : used) {
    if (units != 0) return absl::InternalError("scheduler: limit " + name + " is missing");
  }
  for (const auto& [name, queue] : limited_) {
    if (queued[name] != queue.jobs) return absl::InternalError("scheduler: limited jobs");
    queued.erase(name);
  }
  return queued.empty() ? absl::OkStatus() : absl::InternalError("scheduler: limited jobs");
}

}  // namespace tessera::server
