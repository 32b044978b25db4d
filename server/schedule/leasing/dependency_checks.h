#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "server/schedule/tables/tables.h"

namespace tessera::server {

/// Jobs that wait for others, as a whole or frame by frame. The state of a dependency follows from
/// the state of the other job alone, so it is the same after a restart.
class DependencyChecks {
 public:
  explicit DependencyChecks(Tables& tables)
      : jobs_(tables.jobs), dependencies_(tables.dependencies), ready_(tables.ready) {}

  /// A job that is neither here nor known to be removed could not be read: its dependents wait.
  DependencyState state_of(const Dependency& dependency) const;
  bool is_frame_blocked(const Job& job, std::int32_t frame) const;
  /// Blocks or unblocks the job and its frames. The caller calls refresh().
  void check_dependencies(Job& job);
  /// Call after the job's state or its schedule has changed.
  void check_dependents(const Job& job);
  /// Call after a frame of the job is finished.
  void check_dependents(const Job& job, std::int32_t frame);
  /// Returns whether all dependencies can still be met. Errors: FailedPrecondition, a job that had
  /// to be DONE first was removed before it was.
  absl::Status check_possible(const Job& job) const;
  /// Returns what the job waits for, for its owner; "" if for no other job.
  std::string dependency_text(const Job& job) const;

 private:
  JobTable& jobs_;
  Dependencies& dependencies_;
  ReadyJobs& ready_;
};

}  // namespace tessera::server
