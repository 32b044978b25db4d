#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Dependencies between jobs, and the final states of removed jobs that others depend on. Pure.
class Dependencies {
 public:
  void add(JobKey job, const std::vector<Dependency>& after);
  /// Requires the dependencies with which the job was added.
  void remove(JobKey job, const std::vector<Dependency>& after);
  /// Replaces the dependencies of a job.
  void replace(JobKey job, const std::vector<Dependency>& before,
               const std::vector<Dependency>& after);
  /// Returns the jobs that name this one, oldest first.
  const std::set<JobKey>& dependents(const std::string& job_id) const;

  /// Notes that a job was removed in this state. Forgotten with its last dependent.
  void note_removed(const std::string& job_id, JobState state) { removed_[job_id] = state; }
  /// Returns nullopt for a job that is not known to be removed.
  std::optional<JobState> removed_state(const std::string& job_id) const;

 private:
  std::map<std::string, std::set<JobKey>> dependents_;  // by the job that they name
  std::map<std::string, JobState> removed_;
  std::set<JobKey> none_;  // what dependents() returns for other jobs
};

/// State of a dependency.
enum class DependencyState {
  waiting,
  met,
  impossible,  // the other job was removed and can never be DONE
};

/// Returns the state of a dependency that concerns the whole job, given the other job's state. A
/// dependency of frames counts as met: frames wait one by one.
DependencyState state_of(Dependency::Kind kind, JobState other, bool is_removed);

}  // namespace tessera::server
