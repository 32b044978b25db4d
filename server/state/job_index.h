#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Finds jobs by ID, name, owner and request without visiting all of them. Plain data without a
/// lock; names nothing of a job that has been removed.
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
  struct Entry {
    JobKey key = 0;
    std::string owner;
  };
  using Keys = std::map<std::string, std::set<JobKey>>;
  static void erase(Keys& keys, const std::string& text, JobKey key);

  std::map<std::string, Entry> by_id_;
  std::map<std::string, JobKey> by_request_;
  std::map<std::string, std::map<JobKey, std::string>> by_name_;  // job → owner
  Keys by_owner_;
  std::set<JobKey> none_;  // what of_owner() returns for an unknown owner
};

}  // namespace tessera::server
