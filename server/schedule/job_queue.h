#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <tuple>

#include "server/schedule/job_spec.h"

namespace tessera::server {

/// Jobs with waiting units, ordered by priority, owner and age, and indexed by scene.
///
/// Fair share: within a priority the owner with the least usage goes first. Usage is the CPU
/// seconds that an owner's unfinished jobs have committed or have in flight. Pure; the caller
/// serialises calls.
class JobQueue {
 public:
  /// Determines a job's order.
  struct QueueKey {
    std::int32_t priority = 0;
    std::string owner;
    SceneKey scene;
  };
  /// Requires a job that is not in the queue.
  void insert(JobKey job, const QueueKey& key);
  /// Harmless for a job that is not in the queue. Requires the key with which it was inserted.
  void erase(JobKey job, const QueueKey& key);
  bool empty() const { return jobs_.empty(); }

  /// Adds to an owner's usage, CPU seconds; negative: refunds.
  void charge(const std::string& owner, double cpu_seconds) { usage_[owner] += cpu_seconds; }
  double usage(const std::string& owner) const;

  /// Returns the next job for a worker: of the highest priority that has a job it may work for, the
  /// owner with the least usage (ties: by name), and that owner's oldest job. 0 if there is none.
  JobKey next(const std::function<bool(JobKey)>& may_work_for) const;
  /// Returns whether a job of a priority above `priority` is waiting for the worker.
  bool has_above(std::int32_t priority, const std::function<bool(JobKey)>& may_work_for) const;
  /// Returns the oldest job with this key, scene included, that the worker may work for; 0 if there
  /// is none.
  JobKey oldest(const QueueKey& key, const std::function<bool(JobKey)>& may_work_for) const;
  /// Returns whether any job has this scene.
  bool has_scene(const SceneKey& scene) const { return by_scene_.count(scene) > 0; }

 private:
  using Owners = std::map<std::string, std::set<JobKey>>;
  std::map<std::int32_t, Owners, std::greater<>> jobs_;  // highest priority first
  std::map<SceneKey, std::set<std::tuple<std::int32_t, std::string, JobKey>>> by_scene_;
  std::map<std::string, double> usage_;
};

}  // namespace tessera::server
