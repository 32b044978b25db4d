#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>

#include "server/schedule/job_spec.h"

namespace tessera::server {

/// The jobs that have units waiting, by priority, then owner, then age.
///
/// Fair share: within a priority the owner who has used least goes first; an owner's usage is what
/// its present jobs (not ended) have committed and have leased, in CPU seconds. Pure.
class JobQueue {
 public:
  void insert(JobKey job, std::int32_t priority, const std::string& owner);
  void erase(JobKey job, std::int32_t priority, const std::string& owner);
  bool empty() const { return jobs_.empty(); }

  /// Adds to an owner's usage (negative: takes back), CPU seconds.
  void charge(const std::string& owner, double cpu_seconds) { usage_[owner] += cpu_seconds; }
  double usage(const std::string& owner) const;

  /// The job a worker should turn to: of the highest priority with a job it may work for, the
  /// owner with the least usage (ties: by name), that owner's oldest job. 0 when there is none.
  JobKey next(const std::function<bool(JobKey)>& may_work_for) const;
  /// Whether a job of higher priority than `priority` is waiting for it.
  bool has_above(std::int32_t priority, const std::function<bool(JobKey)>& may_work_for) const;

 private:
  using Owners = std::map<std::string, std::set<JobKey>>;
  std::map<std::int32_t, Owners, std::greater<>> jobs_;  // highest priority first
  std::map<std::string, double> usage_;
};

}  // namespace tessera::server
