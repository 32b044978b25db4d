#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Finds jobs by ID, name, owner and request without visiting others, also among those of one owner
/// only. Plain data without a lock; names nothing of a job that has been removed.
class JobIndex {
 public:
  void add(JobKey key, const JobSpec& spec);
  void remove(JobKey key, const JobSpec& spec);

  /// Returns the job that this request created, or 0.
  JobKey of_request(const std::string& request_id) const;
  /// Returns the job with this ID, or 0.
  JobKey with_id(const std::string& id) const;
  /// Returns the jobs whose ID starts with `prefix`, newest first, but at most `limit`, those that
  /// come first in the alphabet. An empty `owner` stands for all owners.
  std::vector<JobKey> with_prefix(const std::string& prefix, const std::string& owner,
                                  std::size_t limit) const;
  /// Returns the newest job of this name, or 0. An empty `owner` stands for all owners.
  JobKey newest_named(const std::string& name, const std::string& owner) const;
  /// Returns the owner's jobs.
  const std::set<JobKey>& of_owner(const std::string& owner) const;
  /// Returns the owners of jobs.
  std::vector<std::string> owners() const;

 private:
  struct Jobs {
    std::set<JobKey> keys;
    std::map<std::string, JobKey> by_id;
    std::map<std::string, std::set<JobKey>> by_name;

    void add(JobKey key, const JobSpec& spec);
    void remove(JobKey key, const JobSpec& spec);
  };

  /// Returns the owner's jobs, or all for an empty `owner`.
  const Jobs& jobs_of(const std::string& owner) const;

  Jobs all_;
  std::map<std::string, Jobs> by_owner_;
  std::map<std::string, JobKey> by_request_;
  Jobs none_;  // of an unknown owner
};

}  // namespace tessera::server
