// Limits: how many leases may use a licence or another named resource at once. Budgets: whose jobs
// are leased nothing. Changes of jobs.
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "server/schedule/scheduler/scheduler.h"

namespace tessera::server {

void Scheduler::take_limits(Job& job) {
  ++job.lease_count;
  limited_.limits().take(job.spec->limits, 1);
}

void Scheduler::give_back_limits(Job& job) {
  --job.lease_count;
  if (job.spec->limits.empty()) return;
  limited_.limits().take(job.spec->limits, -1);
  work_appeared_ = true;
}

void Scheduler::set_limit(const std::string& name, std::int64_t units, Time now) {
  advance(now);
  limited_.limits().set(name, units);
  work_appeared_ = true;
  dispatch_all(now);
}

bool Scheduler::remove_limit(const std::string& name, Time now) {
  advance(now);
  const bool existed = limited_.limits().remove(name);
  work_appeared_ = true;
  dispatch_all(now);
  return existed;
}

void Scheduler::change(Job& job, std::shared_ptr<const JobSpec> spec, Time now) {
  advance(now);
  for (auto& [unit, audit] : job.audits) stop_waiting(job, unit, audit);
  if (queued_.erase(job.key) > 0) {
    queue_.erase(job.key, queue_key(job));
    limited_.count(job.requirement, job.spec->limits, -1);
  }
  limited_.limits().take(job.spec->limits, -job.lease_count);
  dependencies_.replace(job.key, job.spec->after, spec->after);
  job.spec = std::move(spec);
  job.requirement = job.spec->requirement();
  limited_.limits().take(job.spec->limits, job.lease_count);
  for (auto& [unit, audit] : job.audits) {
    if (!audit.holder) await_worker(job, unit, audit);
  }
  for (const std::string& id : job.spec->blocked_workers) {
    if (Worker* worker = find_worker(id)) revoke_units(*worker, job);
  }
  check_dependencies(job);
  refresh(job);
  dispatch_all(now);
}

/// Returns why units of the job's account are not leased; nullptr if they are.
const std::string* Scheduler::stop_reason(const Job& job) const {
  if (stopped_.empty()) return nullptr;
  auto found = stopped_.find({AccountScope::owner, job.spec->owner});
  if (found == stopped_.end() && !job.spec->project.empty()) {
    found = stopped_.find({AccountScope::project, job.spec->project});
  }
  return found == stopped_.end() ? nullptr : &found->second;
}

void Scheduler::stop_accounts(std::map<Account, std::string> reasons, Time now) {
  advance(now);
  stopped_ = std::move(reasons);
  for (auto& [key, job] : jobs_) {
    const bool is_over_budget = stop_reason(job) != nullptr;
    if (is_over_budget == job.is_over_budget) continue;
    job.is_over_budget = is_over_budget;
    refresh(job);
  }
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
    if (!job.spec->limits.empty() && queued_.count(key) > 0) {
      ++queued[LimitedQueues::name(job.requirement, job.spec->limits)];
    }
  }
  for (const auto& [name, limit] : limits().all()) {
    if (limit.used != used[name]) return absl::InternalError("scheduler: use of limit " + name);
    used.erase(name);
  }
  for (const auto& [name, units] : used) {
    if (units != 0) return absl::InternalError("scheduler: limit " + name + " is missing");
  }
  return limited_.verify(queued);
}

}  // namespace tessera::server
