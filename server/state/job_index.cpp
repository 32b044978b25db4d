#include "server/state/job_index.h"

#include <algorithm>
#include <functional>

#include "absl/strings/match.h"

namespace tessera::server {

void JobIndex::Jobs::add(JobKey key, const JobSpec& spec) {
  keys.insert(key);
  by_id[spec.id] = key;
  by_name[spec.name].insert(key);
}

void JobIndex::Jobs::remove(JobKey key, const JobSpec& spec) {
  keys.erase(key);
  by_id.erase(spec.id);
  const auto named = by_name.find(spec.name);
  if (named == by_name.end()) return;
  named->second.erase(key);
  if (named->second.empty()) by_name.erase(named);
}

void JobIndex::add(JobKey key, const JobSpec& spec) {
  all_.add(key, spec);
  by_owner_[spec.owner].add(key, spec);
  if (!spec.request_id.empty()) by_request_[spec.request_id] = key;
}

void JobIndex::remove(JobKey key, const JobSpec& spec) {
  all_.remove(key, spec);
  by_request_.erase(spec.request_id);
  const auto theirs = by_owner_.find(spec.owner);
  if (theirs == by_owner_.end()) return;
  theirs->second.remove(key, spec);
  if (theirs->second.keys.empty()) by_owner_.erase(theirs);
}

JobKey JobIndex::of_request(const std::string& request_id) const {
  const auto found = by_request_.find(request_id);
  return found == by_request_.end() ? 0 : found->second;
}

JobKey JobIndex::with_id(const std::string& id) const {
  const auto found = all_.by_id.find(id);
  return found == all_.by_id.end() ? 0 : found->second;
}

std::vector<JobKey> JobIndex::with_prefix(const std::string& prefix, const std::string& owner,
                                          std::size_t limit) const {
  const std::map<std::string, JobKey>& by_id = jobs_of(owner).by_id;
  std::vector<JobKey> keys;
  for (auto it = by_id.lower_bound(prefix);
       it != by_id.end() && keys.size() < limit && absl::StartsWith(it->first, prefix); ++it) {
    keys.push_back(it->second);
  }
  std::sort(keys.begin(), keys.end(), std::greater<>());
  return keys;
}

JobKey JobIndex::newest_named(const std::string& name, const std::string& owner) const {
  const Jobs& jobs = jobs_of(owner);
  const auto named = jobs.by_name.find(name);
  return named == jobs.by_name.end() ? 0 : *named->second.rbegin();
}

std::vector<std::string> JobIndex::owners() const {
  std::vector<std::string> names;
  names.reserve(by_owner_.size());
  for (const auto& [owner, jobs] : by_owner_) names.push_back(owner);
  return names;
}

const std::set<JobKey>& JobIndex::of_owner(const std::string& owner) const {
  const auto found = by_owner_.find(owner);
  return found == by_owner_.end() ? none_.keys : found->second.keys;
}

const JobIndex::Jobs& JobIndex::jobs_of(const std::string& owner) const {
  if (owner.empty()) return all_;
  const auto found = by_owner_.find(owner);
  return found == by_owner_.end() ? none_ : found->second;
}

}  // namespace tessera::server
