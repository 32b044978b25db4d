#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Disk space of ended jobs, by job and owner: images, and blocks of jobs that are not DONE. Plain
/// data without a lock.
class KeptResults {
 public:
  /// Sets the size of a job's results; 0 for one that has not ended.
  void set(JobKey key, const std::string& owner, std::int64_t bytes) {
    remove(key);
    if (bytes == 0) return;
    jobs_[key] = {owner, bytes};
    owners_[owner] += bytes;
  }
  void remove(JobKey key) {
    const auto found = jobs_.find(key);
    if (found == jobs_.end()) return;
    const auto owner = owners_.find(found->second.first);
    owner->second -= found->second.second;
    if (owner->second == 0) owners_.erase(owner);
    jobs_.erase(found);
  }
  std::int64_t of_job(JobKey key) const {
    const auto found = jobs_.find(key);
    return found == jobs_.end() ? 0 : found->second.second;
  }
  std::int64_t of_owner(const std::string& owner) const {
    const auto found = owners_.find(owner);
    return found == owners_.end() ? 0 : found->second;
  }

 private:
  std::map<JobKey, std::pair<std::string, std::int64_t>> jobs_;  // owner, bytes
  std::map<std::string, std::int64_t> owners_;
};

}  // namespace tessera::server
