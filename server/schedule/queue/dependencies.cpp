#include "server/schedule/queue/dependencies.h"

#include <algorithm>

namespace tessera::server {

void Dependencies::add(JobKey job, const std::vector<Dependency>& after) {
  for (const Dependency& dependency : after) dependents_[dependency.job_id].insert(job);
}

void Dependencies::remove(JobKey job, const std::vector<Dependency>& after) {
  for (const Dependency& dependency : after) {
    const auto found = dependents_.find(dependency.job_id);
    if (found == dependents_.end()) continue;
    found->second.erase(job);
    if (!found->second.empty()) continue;
    dependents_.erase(found);
    removed_.erase(dependency.job_id);
  }
}

void Dependencies::replace(JobKey job, const std::vector<Dependency>& before,
                           const std::vector<Dependency>& after) {
  std::vector<Dependency> dropped;
  for (const Dependency& dependency : before) {
    const bool stays = std::any_of(after.begin(), after.end(), [&](const Dependency& other) {
      return other.job_id == dependency.job_id;
    });
    if (!stays) dropped.push_back(dependency);
  }
  add(job, after);
  remove(job, dropped);  // forgets how the other job ended, so not for one that stays
}

const std::set<JobKey>& Dependencies::dependents(const std::string& job_id) const {
  const auto found = dependents_.find(job_id);
  return found == dependents_.end() ? none_ : found->second;
}

std::optional<JobState> Dependencies::removed_state(const std::string& job_id) const {
  const auto found = removed_.find(job_id);
  if (found == removed_.end()) return std::nullopt;
  return found->second;
}

DependencyState state_of(Dependency::Kind kind, JobState other, bool is_removed) {
  if (other == JobState::done) return DependencyState::met;
  if (kind == Dependency::Kind::end) {
    return has_ended(other) || is_removed ? DependencyState::met : DependencyState::waiting;
  }
  if (is_removed) return DependencyState::impossible;
  return kind == Dependency::Kind::frames ? DependencyState::met : DependencyState::waiting;
}

}  // namespace tessera::server
