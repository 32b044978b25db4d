#include "server/schedule/leasing/job_choice.h"

#include <algorithm>
#include <limits>
#include <tuple>

namespace tessera::server {

using contract::Unit;

bool JobChoice::may_work_for(const Worker& worker, const Job& job) const {
  const JobSpec& spec = *job.spec;
  if (worker.serves.count(job.requirement) == 0 || ready_.limited().limits().room(spec.limits) == 0)
    return false;
  if (is_barred(worker, job)) return false;
  return spec.max_workers == 0 || job.holders.count(worker.key) > 0 ||
         static_cast<std::int32_t>(job.holders.size()) < spec.max_workers;
}

bool JobChoice::may_take(const Worker& worker, const Job& job, const Unit& unit) const {
  if (job.unit_failures.empty() && job.scene_faults.empty()) return true;
  const std::set<std::string> failed = witnesses_.failed_witnesses(job, unit);
  // It failed on this worker: others go first, if there are any.
  return failed.count(worker.witness) == 0 || !witnesses_.has_others(job, failed);
}

JobKey JobChoice::choose_job(const Worker& worker, const std::set<JobKey>& refused) {
  const std::function<bool(JobKey)> may = [&](JobKey key) {
    counts_.note_step();
    return refused.count(key) == 0 && may_work_for(worker, jobs_.at(key));
  };
  const bool has_waiting =
      ready_.is_queued(worker.current_job) || ready_.full().count(worker.current_job) > 0;
  const Job* current =
      has_waiting && may(worker.current_job) ? jobs_.find(worker.current_job) : nullptr;
  if (current == nullptr) return next_job(worker, may);
  // A worker that has rendered units without a report had the scene loaded already, for instance
  // before this server started, or its report was lost with its stream.
  const bool has_paid_off =
      worker.load_seconds ? worker.seconds_in_job >= policy_.load_factor * *worker.load_seconds
                          : worker.seconds_in_job > 0;
  std::set<std::string> open;  // a worker's own set suffices while no limit is in use
  const std::set<std::string>& queues = ready_.limited().empty()
                                            ? worker.serves
                                            : (open = ready_.limited().open_parts(worker.serves));
  const JobQueue::Seeker seeker{queues, may};
  if (!has_paid_off && !ready_.queue().has_above(current->spec->priority, seeker, ready_.now())) {
    return current->key;
  }
  const JobKey next = next_job(worker, may);
  if (next == 0) return current->key;
  const JobSpec& chosen = *jobs_.at(next).spec;
  const bool equal =
      chosen.priority == current->spec->priority && chosen.owner == current->spec->owner;
  return equal ? current->key : next;  // the worker has its scene
}

/// Returns whether a worker renders the job, or has credits and its scene.
bool JobChoice::has_enough_workers(const Job& job) const {
  if (!job.holders.empty()) return true;
  const std::set<WorkerKey>& workers = scenes_.workers_with(job.scene);
  return std::any_of(workers.begin(), workers.end(), [&](WorkerKey key) {
    const Worker& worker = workers_.at(key);
    return worker.idle_load && may_work_for(worker, job);
  });
}

/// Returns whether the job is leased before the other one, in the order of JobQueue::next().
bool JobChoice::precedes(const Job& job, const Job& other) const {
  const auto use = [this](const Job& of) {
    return ready_.queue().share().position(of.spec->owner);
  };
  if (job.spec->priority != other.spec->priority) return job.spec->priority > other.spec->priority;
  const double used = use(job), other_used = use(other);
  return std::tie(used, job.spec->owner, job.key) <
         std::tie(other_used, other.spec->owner, other.key);
}

/// Returns the first of the jobs that have their maximum of workers, this one among them; 0 if
/// there is none.
JobKey JobChoice::next_full_job(const Worker& worker,
                                const std::function<bool(JobKey)>& may) const {
  if (ready_.full().empty()) return 0;
  constexpr auto kMax = std::numeric_limits<std::int32_t>::max();
  const Job* best = nullptr;
  const auto& units = worker.leased_units;
  for (auto it = units.begin(); it != units.end();
       it = units.upper_bound({it->first, {kMax, kMax, kMax}})) {
    const Job& job = jobs_.at(it->first);
    if (ready_.full().count(job.key) == 0 || job.holders.count(worker.key) == 0 || !may(job.key))
      continue;
    if (best == nullptr || precedes(job, *best)) best = &job;
  }
  return best == nullptr ? 0 : best->key;
}

/// Returns the next job of the queue or, if another worker serves that one, a job of the same owner
/// and priority whose scene this worker has.
JobKey JobChoice::next_job(const Worker& worker, const std::function<bool(JobKey)>& may) {
  std::set<std::string> open;  // a worker's own set suffices while no limit is in use
  const std::set<std::string>& queues = ready_.limited().empty()
                                            ? worker.serves
                                            : (open = ready_.limited().open_parts(worker.serves));
  const JobQueue::Seeker seeker{queues, may};
  const JobKey next = ready_.queue().next(seeker, ready_.now());
  const JobKey full = next_full_job(worker, may);
  if (next == 0) return full;
  const Job& job = jobs_.at(next);
  if (full != 0 && !ready_.queue().is_overdue(ReadyJobs::key_of(job), ready_.now()) &&
      precedes(jobs_.at(full), job)) {
    return full;
  }
  if (worker.scenes.empty() || has_scene(worker, job) || !has_enough_workers(job)) return next;
  JobKey nearest = 0;
  for (const SceneKey& scene : worker.scenes) {
    const JobKey found =
        ready_.queue().oldest({job.spec->priority, job.spec->owner, scene}, seeker);
    if (found != 0 && (nearest == 0 || found < nearest)) nearest = found;
  }
  return nearest == 0 ? next : nearest;
}

}  // namespace tessera::server
