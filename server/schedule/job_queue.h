#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <tuple>

#include "server/schedule/job_spec.h"

namespace tessera::server {

/// The jobs that have units waiting, by priority, then owner, then age; and by their scenes.
///
/// Fair share: within a priority the owner who has used least goes first; an owner's usage is what
/// its present jobs (not ended) have committed and have leased, in CPU seconds. Pure.
class JobQueue {
 public:
  /// Where a job stands.
  struct QueueKey {
    std::int32_t priority = 0;
    std::string owner;
    SceneKey scene;
  };
  /// Requires a job that is not here.
  void insert(JobKey job, const QueueKey& key);
  /// Harmless if it is not here. Requires the place it was inserted at.
  void erase(JobKey job, const QueueKey& key);
  bool empty() const { return jobs_.empty(); }

  /// Adds to an owner's usage (negative: takes back), CPU seconds.
  void charge(const std::string& owner, double cpu_seconds) { usage_[owner] += cpu_seconds; }
  double usage(const std::string& owner) const;

  /// The job a worker should turn to: of the highest priority with a job it may work for, the
  /// owner with the least usage (ties: by name), that owner's oldest job. 0 when there is none.
  JobKey next(const std::function<bool(JobKey)>& may_work_for) const;
  /// Whether a job of higher priority than `priority` is waiting for it.
  bool has_above(std::int32_t priority, const std::function<bool(JobKey)>& may_work_for) const;
  /// The oldest job at this place, scene included, that the worker may work for; 0: there is none.
  JobKey oldest_of(const QueueKey& key, const std::function<bool(JobKey)>& may_work_for) const;
  /// Whether any job has this scene.
  bool has_scene(const SceneKey& scene) const { return by_scene_.count(scene) > 0; }

 private:
  using Owners = std::map<std::string, std::set<JobKey>>;
  std::map<std::int32_t, Owners, std::greater<>> jobs_;  // highest priority first
  std::map<SceneKey, std::set<std::tuple<std::int32_t, std::string, JobKey>>> by_scene_;
  std::map<std::string, double> usage_;
};

}  // namespace tessera::server
