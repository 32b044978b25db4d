#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "server/schedule/workers/farm_census.h"
#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// Sums over the workers, and those that have credits, kept up to date one worker at a time. Pure.
class WorkerCounts {
 public:
  /// Workers with credits: load, key.
  using IdleWorkers = std::set<std::pair<double, WorkerKey>>;

  /// Call before the tags, threads, host or witness of a worker change.
  void uncount(Worker& worker);
  /// Call after the state of a worker has changed.
  void recount(Worker& worker);
  /// Call after a worker's credits or units have changed.
  void update_idle(Worker& worker);

  /// Working workers.
  const FarmCensus& working() const { return working_; }
  /// The same and those whose stream has just broken.
  const FarmCensus& present() const { return present_; }
  /// Working workers with credits, least loaded first.
  const IdleWorkers& idle() const { return idle_; }
  /// Number of idle workers by tag; "": all.
  const std::map<std::string, std::int32_t>& idle_tags() const { return idle_tags_; }

  void note_step() { ++step_count_; }
  /// Number of workers and jobs visited so far. Tests of cost count these steps instead of time.
  std::int64_t step_count() const { return step_count_; }

 private:
  void count(Worker& worker);
  void count_idle_tags(const Worker& worker, std::int32_t change);

  FarmCensus working_;
  FarmCensus present_;
  IdleWorkers idle_;
  std::map<std::string, std::int32_t> idle_tags_;
  std::int64_t step_count_ = 0;
};

}  // namespace tessera::server
