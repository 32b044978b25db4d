#include "server/schedule/queue/job_queue.h"

#include <algorithm>

namespace tessera::server {
namespace {

constexpr double kFadedLift = 1e-3;  // CPU seconds that no longer matter

JobKey first_of(const std::map<std::int32_t, std::set<JobKey>, std::greater<>>& jobs,
                const std::function<bool(JobKey)>& may_work_for) {
  for (const auto& [priority, keys] : jobs) {
    const auto job = std::find_if(keys.begin(), keys.end(), may_work_for);
    if (job != keys.end()) return *job;
  }
  return 0;
}

}  // namespace

JobQueue::JobQueue(const SharePolicy& policy, Time start)
    : policy_(policy), share_(policy.half_life, policy.weights, start) {}

void JobQueue::for_each_bucket(const Seeker& seeker, const std::function<void(Bucket&)>& visit) {
  const auto visit_tag = [&](const std::string& tag) {
    const auto bucket = buckets_.find(tag);
    if (bucket != buckets_.end() && !bucket->second.entries.empty()) visit(bucket->second);
  };
  visit_tag("");
  for (const std::string& tag : seeker.tags) {
    if (!tag.empty()) visit_tag(tag);
  }
}

double JobQueue::lifted_position(const Bucket& bucket, const std::string& owner) const {
  const auto lift = bucket.lifts.find(owner);
  return share_.position(owner) + (lift == bucket.lifts.end() ? 0 : lift->second);
}

/// Lets an owner who comes to the jobs of a tag lag behind by no more than `catch_up`. The lift
/// stays with the owner, so that coming again and again gains nothing.
void JobQueue::lift(Bucket& bucket, const QueueKey& key, Time now, std::int32_t threads) {
  const double lead = share_.step(key.owner, seconds(policy_.catch_up) * threads, now);
  const double lack = bucket.floor - lead - lifted_position(bucket, key.owner);
  if (lack > 0) bucket.lifts[key.owner] += lack;
}

void JobQueue::insert(JobKey job, const QueueKey& key, Time now, std::int32_t threads) {
  Bucket& bucket = buckets_[key.tag];
  const auto [found, is_new] = bucket.entries.try_emplace(key.owner);
  Entry& entry = found->second;
  if (is_new) {
    lift(bucket, key, now, threads);
    entry.position = lifted_position(bucket, key.owner);
    entry.since = now;
    bucket.by_wait.emplace(now, key.owner);
    tags_[key.owner].insert(key.tag);
  }
  if (entry.jobs[key.priority].insert(job).second) ++job_count_;
  bucket.levels[key.priority].emplace(entry.position, key.owner);
  by_scene_[key.scene].emplace(key.tag, key.priority, key.owner, job);
}

void JobQueue::erase(JobKey job, const QueueKey& key) {
  const auto scene = by_scene_.find(key.scene);
  if (scene != by_scene_.end()) {
    scene->second.erase({key.tag, key.priority, key.owner, job});
    if (scene->second.empty()) by_scene_.erase(scene);
  }
  const auto found_bucket = buckets_.find(key.tag);
  if (found_bucket == buckets_.end()) return;
  Bucket& bucket = found_bucket->second;
  const auto found_entry = bucket.entries.find(key.owner);
  if (found_entry == bucket.entries.end()) return;
  Entry& entry = found_entry->second;
  const auto jobs = entry.jobs.find(key.priority);
  if (jobs == entry.jobs.end() || jobs->second.erase(job) == 0) return;
  --job_count_;
  if (!jobs->second.empty()) return;
  entry.jobs.erase(jobs);
  const auto level = bucket.levels.find(key.priority);
  level->second.erase({entry.position, key.owner});
  if (level->second.empty()) bucket.levels.erase(level);
  if (!entry.jobs.empty()) return;
  bucket.by_wait.erase({entry.since, key.owner});
  bucket.entries.erase(found_entry);
  const auto tags = tags_.find(key.owner);
  tags->second.erase(key.tag);
  if (tags->second.empty()) tags_.erase(tags);
  if (bucket.entries.empty() && !(bucket.floor > 0)) buckets_.erase(found_bucket);
}

void JobQueue::charge(const std::string& owner, double cpu_seconds, Time when) {
  share_.charge(owner, cpu_seconds, when);
  if (tags_.count(owner) > 0) dirty_.insert(owner);
}

void JobQueue::restore(const std::vector<UsageRow>& table, Time now) {
  share_.restore(table, now);
  for (const auto& [owner, tags] : tags_) dirty_.insert(owner);
}

void JobQueue::move_to(Bucket& bucket, const std::string& owner, double position) {
  Entry& entry = bucket.entries.at(owner);
  for (const auto& [priority, jobs] : entry.jobs) {
    Order& order = bucket.levels.at(priority);
    order.erase({entry.position, owner});
    order.emplace(position, owner);
  }
  entry.position = position;
}

void JobQueue::sort() {
  for (const std::string& owner : dirty_) {
    const auto tags = tags_.find(owner);
    if (tags == tags_.end()) continue;
    for (const std::string& tag : tags->second) {
      Bucket& bucket = buckets_.at(tag);
      move_to(bucket, owner, lifted_position(bucket, owner));
    }
  }
  dirty_.clear();
}

void JobQueue::set_since(Bucket& bucket, const std::string& owner, Time since) {
  Entry& entry = bucket.entries.at(owner);
  bucket.by_wait.erase({entry.since, owner});
  entry.since = since;
  bucket.by_wait.emplace(since, owner);
}

void JobQueue::note_leased(const QueueKey& key, Time now) {
  const auto found = buckets_.find(key.tag);
  if (found == buckets_.end()) return;
  Bucket& bucket = found->second;
  const auto entry = bucket.entries.find(key.owner);
  if (entry == bucket.entries.end()) return;
  // An owner who goes first because it has waited says nothing about the others' use.
  const bool was_overdue = now - entry->second.since >= policy_.max_wait;
  if (!was_overdue) bucket.floor = std::max(bucket.floor, entry->second.position);
  set_since(bucket, key.owner, now);
}

void JobQueue::rebuild(double factor) {
  for (auto& [tag, bucket] : buckets_) {
    bucket.floor *= factor;
    for (auto& [owner, lift] : bucket.lifts) lift *= factor;
    bucket.levels.clear();
    for (auto& [owner, entry] : bucket.entries) {
      entry.position = lifted_position(bucket, owner);
      for (const auto& [priority, jobs] : entry.jobs) {
        bucket.levels[priority].emplace(entry.position, owner);
      }
    }
  }
  dirty_.clear();
}

void JobQueue::advance(Time now) {
  if (share_.needs_rebase(now)) rebuild(share_.rebase(now));
  sort();
  const double faded = share_.step("", kFadedLift, now);
  for (auto it = buckets_.begin(); it != buckets_.end();) {
    Bucket& bucket = it->second;
    std::erase_if(bucket.lifts, [&](const auto& lift) {
      return lift.second < faded && bucket.entries.count(lift.first) == 0;
    });
    const bool is_over = bucket.entries.empty() && bucket.floor < faded;
    it = is_over ? buckets_.erase(it) : std::next(it);
  }
  share_.forget_faded(now);
  for (const auto& [owner, tags] : tags_) dirty_.insert(owner);  // some positions are 0 now
  sort();
}

/// Returns the job of the owner that has waited longest, if that exceeds max_wait; otherwise 0.
JobKey JobQueue::overdue(const Seeker& seeker, Time now) {
  JobKey best = 0;
  Time since = now;
  for_each_bucket(seeker, [&](Bucket& bucket) {
    for (const auto& [waiting_since, owner] : bucket.by_wait) {
      if (now - waiting_since < policy_.max_wait) return;
      if (best != 0 && waiting_since >= since) return;
      const JobKey job = first_of(bucket.entries.at(owner).jobs, seeker.may_work_for);
      if (job == 0) continue;
      best = job;
      since = waiting_since;
    }
  });
  return best;
}

JobQueue::Candidate JobQueue::front(const Bucket& bucket,
                                    const std::function<bool(JobKey)>& may_work_for) const {
  for (const auto& [priority, order] : bucket.levels) {
    for (const auto& [position, owner] : order) {
      const std::set<JobKey>& jobs = bucket.entries.at(owner).jobs.at(priority);
      const auto job = std::find_if(jobs.begin(), jobs.end(), may_work_for);
      if (job != jobs.end()) return {*job, priority, share_.position(owner), owner};
    }
  }
  return {};
}

JobKey JobQueue::next(const Seeker& seeker, Time now) {
  sort();
  if (const JobKey job = overdue(seeker, now); job != 0) return job;
  Candidate best;
  for_each_bucket(seeker, [&](Bucket& bucket) {
    Candidate candidate = front(bucket, seeker.may_work_for);
    if (candidate.job == 0) return;
    if (best.job == 0 || candidate.goes_before(best)) best = std::move(candidate);
  });
  return best.job;
}

bool JobQueue::has_above(std::int32_t priority, const Seeker& seeker, Time now) {
  if (overdue(seeker, now) != 0) return true;
  bool found = false;
  for_each_bucket(seeker, [&](Bucket& bucket) {
    for (const auto& [level, order] : bucket.levels) {
      if (level <= priority || found) return;
      for (const auto& [position, owner] : order) {
        const std::set<JobKey>& jobs = bucket.entries.at(owner).jobs.at(level);
        found = found || std::any_of(jobs.begin(), jobs.end(), seeker.may_work_for);
      }
    }
  });
  return found;
}

JobKey JobQueue::oldest(const QueueKey& key, const Seeker& seeker) const {
  const auto scene = by_scene_.find(key.scene);
  if (scene == by_scene_.end()) return 0;
  JobKey best = 0;
  const auto look = [&](const std::string& tag) {
    auto it = scene->second.lower_bound({tag, key.priority, key.owner, 0});
    for (; it != scene->second.end(); ++it) {
      const auto& [job_tag, priority, owner, job] = *it;
      if (job_tag != tag || priority != key.priority || owner != key.owner) return;
      if (best != 0 && job >= best) return;
      if (!seeker.may_work_for(job)) continue;
      best = job;
      return;
    }
  };
  look("");
  for (const std::string& tag : seeker.tags) {
    if (!tag.empty()) look(tag);
  }
  return best;
}

JobKey JobQueue::oldest_of(const QueueKey& key) const {
  const auto bucket = buckets_.find(key.tag);
  if (bucket == buckets_.end()) return 0;
  const auto entry = bucket->second.entries.find(key.owner);
  if (entry == bucket->second.entries.end()) return 0;
  const auto jobs = entry->second.jobs.find(key.priority);
  return jobs == entry->second.jobs.end() ? 0 : *jobs->second.begin();
}

bool JobQueue::is_overdue(const QueueKey& key, Time now) const {
  const auto bucket = buckets_.find(key.tag);
  if (bucket == buckets_.end()) return false;
  const auto entry = bucket->second.entries.find(key.owner);
  return entry != bucket->second.entries.end() && now - entry->second.since >= policy_.max_wait;
}

bool JobQueue::is_outranked(const QueueKey& key) const {
  const auto bucket = buckets_.find(key.tag);
  if (bucket == buckets_.end() || bucket->second.levels.empty()) return false;
  return bucket->second.levels.begin()->first > key.priority;
}

bool JobQueue::is_beyond_share(const QueueKey& key) const {
  const auto bucket = buckets_.find(key.tag);
  if (bucket == buckets_.end()) return false;
  const auto level = bucket->second.levels.find(key.priority);
  if (level == bucket->second.levels.end() || level->second.empty()) return false;
  return level->second.begin()->second != key.owner;
}

}  // namespace tessera::server
