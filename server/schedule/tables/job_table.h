#pragma once

#include <functional>
#include <map>
#include <string>

#include "server/schedule/plan/job.h"

namespace tessera::server {

/// Jobs by key and by ID, and what owners need for their unfinished jobs. Pure.
class JobTable {
 public:
  /// Adds a job. Requires a new key and ID.
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

  /// Adds the job's needs to the sum of its owner; `sign` -1 takes them back.
  void count_demand(const Job& job, int sign);
  /// Returns the sum over the owner's unfinished jobs. Cost: one look-up.
  Demand demand(const std::string& owner) const;

 private:
  std::map<JobKey, Job> jobs_;
  std::map<std::string, JobKey> by_id_;
  std::map<std::string, Demand> demands_;  // of unfinished jobs, by owner
};

}  // namespace tessera::server
