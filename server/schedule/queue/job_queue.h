#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "server/schedule/plan/job_spec.h"
#include "server/schedule/queue/fair_share.h"

namespace tessera::server {

/// Constants of fair share (docs/explanation/architecture.md).
struct SharePolicy {
  Duration half_life = std::chrono::hours(1);   // after which use counts half
  Duration catch_up = std::chrono::minutes(1);  // work of the whole farm by which an owner who
                                                // comes back may lag behind the others
  Duration max_wait = std::chrono::minutes(5);  // an owner that has waited this long goes first
  std::map<std::string, double> weights;        // by owner; others have 1
};

/// Jobs with waiting units, by required tag, priority, owner and age, and by scene.
///
/// A worker looks only at jobs without a required tag and at those of its own tags, so jobs that no
/// worker can serve cost nothing. Within a priority the owner with the least use goes first
/// (FairShare). Two rules bound the wait. When an owner's first job of a tag arrives, the owner's
/// use is raised to at most `catch_up` below that of the owners being served; otherwise a newcomer
/// would get the whole farm until its use had caught up. And an owner to whom nothing was leased
/// for `max_wait` goes first once, whatever the priority. Pure; the caller serialises calls.
class JobQueue {
 public:
  explicit JobQueue(const SharePolicy& policy = {}, Time start = {});

  /// Determines a job's order.
  struct QueueKey {
    std::int32_t priority = 0;
    std::string owner;
    SceneKey scene;
    std::string tag = {};  // that a worker must have; empty: none
  };
  /// A worker that looks for a job: its tags, and which jobs it may take.
  struct Seeker {
    const std::set<std::string>& tags;
    const std::function<bool(JobKey)>& may_work_for;
  };
  /// Requires a job that is not in the queue. `threads`: threads of the workers with the tag.
  void insert(JobKey job, const QueueKey& key, Time now = {}, std::int32_t threads = 1);
  /// Harmless for a job that is not in the queue. Requires the key with which it was inserted.
  void erase(JobKey job, const QueueKey& key);
  bool empty() const { return job_count_ == 0; }
  std::size_t size() const { return job_count_; }
  /// Returns whether a job requires one of these tags or none. Cost: the smaller number of tags.
  template <typename ByTag>
  bool has_any(const ByTag& tags) const;

  /// Adds to an owner's use, CPU seconds. Negative: takes back a charge with the same `when`.
  void charge(const std::string& owner, double cpu_seconds, Time when = {});
  /// Changes the weight of later charges. The caller takes back the charges that it may still take
  /// back, and makes them again afterwards.
  void set_weight(const std::string& owner, double weight) { share_.set_weight(owner, weight); }
  const FairShare& share() const { return share_; }
  void restore(const std::vector<UsageRow>& table, Time now);
  /// Sorts owners whose use has changed. Once for many charges, before the next question.
  void sort();
  /// Notes that units of the job were leased.
  void note_leased(const QueueKey& key, Time now);
  /// Keeps positions finite and forgets decayed use. Call at least every few minutes.
  void advance(Time now);

  /// Returns the next job for a worker, among the jobs that it may work for; 0 if there is none. A
  /// job of an owner that has waited longer than max_wait comes first. Otherwise it is the oldest
  /// job of the owner with the least use (ties: by name) at the highest priority.
  JobKey next(const Seeker& seeker, Time now = {});
  /// Returns whether a job precedes those of `priority` for the worker: of a higher priority, or of
  /// an owner that has waited longer than max_wait.
  bool has_above(std::int32_t priority, const Seeker& seeker, Time now = {});
  /// Returns the oldest job with this priority, owner and scene that the worker may work for; 0 if
  /// there is none.
  JobKey oldest(const QueueKey& key, const Seeker& seeker) const;
  /// Returns the owner's oldest job with this priority and tag; 0 if there is none.
  JobKey oldest_of(const QueueKey& key) const;
  /// Returns whether the owner has waited too long for a lease of jobs with this tag.
  bool is_overdue(const QueueKey& key, Time now) const;
  /// Returns whether any job has this scene.
  bool has_scene(const SceneKey& scene) const { return by_scene_.count(scene) > 0; }

  /// Returns whether a job of a higher priority waits for the same tag.
  bool is_outranked(const QueueKey& key) const;
  /// Returns whether an owner with less use has a job of the same tag and priority, as of the last
  /// sort().
  bool is_beyond_share(const QueueKey& key) const;

 private:
  using Jobs =
      std::map<std::int32_t, std::set<JobKey>, std::greater<>>;  // by priority, highest first
  struct Entry {                                                 // an owner's jobs with one tag
    Jobs jobs;
    Time since;           // last lease, else arrival
    double position = 0;  // under which it is in `levels`
  };
  using Order = std::set<std::pair<double, std::string>>;  // position, owner
  struct Bucket {                                          // jobs with one required tag
    std::map<std::string, Entry> entries;
    std::map<std::int32_t, Order, std::greater<>> levels;  // owners, by priority
    std::set<std::pair<Time, std::string>> by_wait;        // owners, by Entry::since
    double floor = 0;                     // highest position that was next when it was leased
    std::map<std::string, double> lifts;  // added to positions of owners, see `catch_up`
  };
  struct Candidate {
    JobKey job = 0;
    std::int32_t priority = 0;
    double position = 0;  // without lift: comparable between tags
    std::string owner;
    bool goes_before(const Candidate& other) const {
      if (priority != other.priority) return priority > other.priority;
      return std::tie(position, owner, job) < std::tie(other.position, other.owner, other.job);
    }
  };

  void for_each_bucket(const Seeker& seeker, const std::function<void(Bucket&)>& visit);
  double lifted_position(const Bucket& bucket, const std::string& owner) const;
  void lift(Bucket& bucket, const QueueKey& key, Time now, std::int32_t threads);
  void move_to(Bucket& bucket, const std::string& owner, double position);
  void set_since(Bucket& bucket, const std::string& owner, Time since);
  void rebuild(double factor);
  JobKey overdue(const Seeker& seeker, Time now);
  Candidate front(const Bucket& bucket, const std::function<bool(JobKey)>& may_work_for) const;

  SharePolicy policy_;
  FairShare share_;
  std::size_t job_count_ = 0;
  std::map<std::string, Bucket> buckets_;              // by tag
  std::map<std::string, std::set<std::string>> tags_;  // with jobs, by owner
  std::set<std::string> dirty_;                        // owners whose positions have changed
  std::map<SceneKey, std::set<std::tuple<std::string, std::int32_t, std::string, JobKey>>>
      by_scene_;  // tag, priority, owner, job
};

template <typename ByTag>
bool JobQueue::has_any(const ByTag& tags) const {
  const auto has_jobs = [this](const std::string& tag) {
    const auto bucket = buckets_.find(tag);
    return bucket != buckets_.end() && !bucket->second.entries.empty();
  };
  if (tags.size() <= buckets_.size()) {
    for (const auto& [tag, ignored] : tags) {
      if (has_jobs(tag)) return true;
    }
    return false;
  }
  for (const auto& [tag, bucket] : buckets_) {
    if (!bucket.entries.empty() && tags.count(tag) > 0) return true;
  }
  return false;
}

}  // namespace tessera::server
