#include "server/schedule/job_queue.h"

#include <algorithm>

namespace tessera::server {

void JobQueue::insert(JobKey job, const QueueKey& key) {
  jobs_[key.priority][key.owner].insert(job);
  by_scene_[key.scene].emplace(key.priority, key.owner, job);
}

void JobQueue::erase(JobKey job, const QueueKey& key) {
  const auto scene = by_scene_.find(key.scene);
  if (scene != by_scene_.end()) {
    scene->second.erase({key.priority, key.owner, job});
    if (scene->second.empty()) by_scene_.erase(scene);
  }
  const auto level = jobs_.find(key.priority);
  if (level == jobs_.end()) return;
  const auto own = level->second.find(key.owner);
  if (own == level->second.end()) return;
  own->second.erase(job);
  if (own->second.empty()) level->second.erase(own);
  if (level->second.empty()) jobs_.erase(level);
}

double JobQueue::usage(const std::string& owner) const {
  const auto found = usage_.find(owner);
  return found == usage_.end() ? 0 : found->second;
}

JobKey JobQueue::next(const std::function<bool(JobKey)>& may_work_for) const {
  for (const auto& [priority, owners] : jobs_) {
    JobKey best = 0;
    double least_usage = 0;
    for (const auto& [owner, jobs] : owners) {
      const double used = usage(owner);
      if (best != 0 && used >= least_usage) continue;
      const auto job = std::find_if(jobs.begin(), jobs.end(), may_work_for);
      if (job == jobs.end()) continue;
      best = *job;
      least_usage = used;
    }
    if (best != 0) return best;
  }
  return 0;
}

bool JobQueue::has_above(std::int32_t priority,
                         const std::function<bool(JobKey)>& may_work_for) const {
  for (const auto& [level, owners] : jobs_) {
    if (level <= priority) return false;
    for (const auto& [owner, jobs] : owners) {
      if (std::any_of(jobs.begin(), jobs.end(), may_work_for)) return true;
    }
  }
  return false;
}

JobKey JobQueue::oldest(const QueueKey& key,
                        const std::function<bool(JobKey)>& may_work_for) const {
  const auto scene = by_scene_.find(key.scene);
  if (scene == by_scene_.end()) return 0;
  for (auto it = scene->second.lower_bound({key.priority, key.owner, 0}); it != scene->second.end();
       ++it) {
    const auto& [priority, owner, job] = *it;
    if (priority != key.priority || owner != key.owner) return 0;
    if (may_work_for(job)) return job;
  }
  return 0;
}

}  // namespace tessera::server
