#include "server/state/job_index.h"

#include <algorithm>
#include <functional>

#include "absl/strings/match.h"

namespace tessera::server {

void JobIndex::add(JobKey key, const JobSpec& spec) {
  by_id_[spec.id] = {key, spec.owner};
  if (!spec.request_id.empty()) by_request_[spec.request_id] = key;
  by_name_[spec.name][key] = spec.owner;
  by_owner_[spec.owner].insert(key);
}

void JobIndex::erase(Keys& keys, const std::string& text, JobKey key) {
  const auto found = keys.find(text);
  if (found == keys.end()) return;
  found->second.erase(key);
  if (found->second.empty()) keys.erase(found);
}

void JobIndex::remove(JobKey key, const JobSpec& spec) {
  by_id_.erase(spec.id);
  by_request_.erase(spec.request_id);
  erase(by_owner_, spec.owner, key);
  const auto named = by_name_.find(spec.name);
  if (named == by_name_.end()) return;
  named->second.erase(key);
  if (named->second.empty()) by_name_.erase(named);
}

JobKey JobIndex::of_request(const std::string& request_id) const {
  const auto found = by_request_.find(request_id);
  return found == by_request_.end() ? 0 : found->second;
}

JobKey JobIndex::with_id(const std::string& id) const {
  const auto found = by_id_.find(id);
  return found == by_id_.end() ? 0 : found->second.key;
}

std::vector<JobKey> JobIndex::with_prefix(const std::string& prefix, const std::string& owner,
                                          std::size_t limit) const {
  std::vector<JobKey> keys;
  for (auto it = by_id_.lower_bound(prefix);
       it != by_id_.end() && keys.size() < limit && absl::StartsWith(it->first, prefix); ++it) {
    if (owner.empty() || it->second.owner == owner) keys.push_back(it->second.key);
  }
  std::sort(keys.begin(), keys.end(), std::greater<>());
  return keys;
}

JobKey JobIndex::newest_named(const std::string& name, const std::string& owner) const {
  const auto found = by_name_.find(name);
  if (found == by_name_.end()) return 0;
  for (auto job = found->second.rbegin(); job != found->second.rend(); ++job) {
    if (owner.empty() || job->second == owner) return job->first;
  }
  return 0;
}

std::vector<std::string> JobIndex::owners() const {
  std::vector<std::string> names;
  names.reserve(by_owner_.size());
  for (const auto& [owner, keys] : by_owner_) names.push_back(owner);
  return names;
}

const std::set<JobKey>& JobIndex::of_owner(const std::string& owner) const {
  const auto found = by_owner_.find(owner);
  return found == by_owner_.end() ? none_ : found->second;
}

}  // namespace tessera::server
