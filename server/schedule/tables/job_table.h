#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <set>
#include <string>

#include "server/schedule/plan/job.h"

namespace tessera::server {

/// Jobs by key, by ID and by state, and what owners need for their unfinished jobs. Pure.
class JobTable {
 public:
  /// Adds a queued job. Requires a new key and ID.
  Job& add(JobKey key, const std::string& id);
  void erase(JobKey key);
  /// Null: there is no such job.
  Job* find(JobKey key);
  const Job* find(JobKey key) const;
  Job* find(const std::string& id);
  const Job* find(const std::string& id) const;
  Job& at(JobKey key) { return jobs_.at(key); }
  const Job& at(JobKey key) const { return jobs_.at(key); }
  const std::map<JobKey, Job>& all() const { return jobs_; }
  void for_each(const std::function<void(Job&)>& visit);

  /// Changes the state of a job, and nothing that follows from it.
  void set_state(Job& job, JobState state);
  const std::set<JobKey>& of_state(JobState state) const { return by_state_[index(state)]; }

  /// Adds the job's needs to the sum of its owner; `sign` -1 takes them back.
  void count_demand(const Job& job, int sign);
  /// Returns the sum over the owner's unfinished jobs. Cost: one look-up.
  Demand demand(const std::string& owner) const;

 private:
  static std::size_t index(JobState state) { return static_cast<std::size_t>(state) - 1; }

  std::map<JobKey, Job> jobs_;
  std::map<std::string, JobKey> by_id_;
  std::array<std::set<JobKey>, kJobStates> by_state_;
  std::map<std::string, Demand> demands_;  // of unfinished jobs, by owner
};

}  // namespace tessera::server
