#include "tests/unit/server/simulation/fairness_checks.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

/// Steps after which a worker with credits must have been leased a unit that it may render: the
/// timer runs once a step, and units may begin to wait after it.
constexpr int kIdleSteps = 2;

bool has_failures(const Job& job) {
  return !job.unit_failures.empty() || !job.scene_faults.empty();
}

std::int64_t waiting_units(const Job& job) {
  return job.plan ? job.plan->counts().waiting : job.unit_count;
}

/// Returns whether the lease is of an audit or a copy of a slow unit, which have their own order.
bool is_apart(const Job& job, const Lease& lease) {
  const contract::Unit unit{lease.frame, lease.first_tile, lease.pass};
  if (job.audits.count(unit) > 0) return true;
  if (!job.plan) return false;
  const auto in_flight = job.plan->in_flight().find(unit);
  return in_flight != job.plan->in_flight().end() && in_flight->second.copied;
}

/// Returns whether it cannot be told what the lease is: the unit was committed since, or another
/// worker has connected that holds it too, from an earlier server.
bool is_unclear(const Job& job, const Lease& lease) {
  if (!job.plan) return false;
  const contract::Unit unit{lease.frame, lease.first_tile, lease.pass};
  if (!job.plan->contains(unit) || job.plan->is_committed(unit)) return true;
  const auto in_flight = job.plan->in_flight().find(unit);
  return in_flight != job.plan->in_flight().end() && in_flight->second.holders.size() > 1;
}

}  // namespace

FairnessChecks::FairnessChecks(SchedulePolicy policy, const Workers& workers, double unit_seconds)
    : policy_(std::move(policy)), workers_(workers), unit_seconds_(unit_seconds) {}

void FairnessChecks::violate(const std::string& what) {
  if (violation_.empty()) violation_ = what;
}

double FairnessChecks::weight(const std::string& owner) const {
  const auto found = policy_.share.weights.find(owner);
  return found == policy_.share.weights.end() ? 1 : found->second;
}

double FairnessChecks::scale(Time now) const {
  return std::exp2(seconds(now - start_) / seconds(policy_.share.half_life));
}

void FairnessChecks::note_start(Time now) {
  start_ = quiet_since_ = now;
  last_ = {};
  sent_.clear();
  changed_.clear();
  waiting_.clear();
  last_job_.clear();
  holds_.clear();
  idle_.clear();
  cpu_seconds_.clear();
  running_since_.clear();
  use_.clear();
  windows_.clear();
}

void FairnessChecks::note_sent(const std::string& worker_id, const std::vector<Lease>& leases) {
  for (const Lease& lease : leases) sent_.push_back({worker_id, lease});
}

/// Returns the leases since the last step in order. `is_complete`: none of them was dropped unseen
/// with the messages of a stream that has ended.
std::vector<FairnessChecks::Grant> FairnessChecks::take_grants(const FarmView& farm,
                                                               bool& is_complete) {
  std::vector<Grant> grants = std::exchange(sent_, {});
  for (const auto& [key, worker] : farm.scheduler().workers().all()) {
    for (const Lease& lease : worker.outbox.leases) grants.push_back({worker.id, lease});
  }
  std::erase_if(grants, [this](const Grant& grant) { return grant.lease.attempt <= last_; });
  std::sort(grants.begin(), grants.end());
  const Attempt newest = farm.scheduler().last_attempt();
  is_complete = newest.counter - last_.counter == static_cast<std::int64_t>(grants.size());
  last_ = newest;
  return grants;
}

/// A job may have been paused and resumed since the last step, by a full disk. It has then left the
/// queue, and the wait of its owner starts anew.
void FairnessChecks::note_interruption(JobKey key, const Job& job) {
  std::optional<Time>& before = running_since_[key];
  if (before && job.running_since != before) changed_.insert(job.spec->owner);
  before = job.running_since;
}

/// Notes what waits, what workers hold and what owners have used. Returns the owners of whose jobs
/// this cannot be told, because units have failed.
std::set<std::string> FairnessChecks::observe(const FarmView& farm, Time now) {
  std::set<std::string> doubtful;
  runnable_.clear();
  for (auto& [owner, use] : use_) {
    use.leased = 0;
    use.priority.reset();
  }
  for (const auto& [key, job] : farm.scheduler().jobs().all()) {
    const std::string& owner = job.spec->owner;
    Use& use = use_[owner];
    const auto [counted, is_new] = cpu_seconds_.emplace(key, job.counters.cpu_seconds);
    use.committed += (job.counters.cpu_seconds - counted->second) * scale(now);
    counted->second = job.counters.cpu_seconds;
    note_interruption(key, job);
    for (const auto& [worker, units] : job.holders) use.leased += units * unit_seconds_;
    if (!job.is_runnable()) continue;
    if (has_failures(job)) {
      doubtful.insert(owner);
      continue;
    }
    runnable_[owner].insert(key);
    const std::int64_t many = 4 * std::max(workers_.credit_count, 1);
    const bool has_times = job.times.median(1).has_value();  // expected seconds are right
    if (waiting_units(job) < many || !has_times) continue;
    use.priority = std::max(use.priority.value_or(job.spec->priority), job.spec->priority);
  }
  return doubtful;
}

void FairnessChecks::check_order(const FarmView& farm, const Grant& grant, const std::string& owner,
                                 Time now) {
  const auto own = waiting_.find(owner);
  if (own != waiting_.end() && !own->second.since) return;  // not known
  const Time since = own == waiting_.end() ? now : *own->second.since;
  const Worker* worker = farm.scheduler().workers().find(grant.worker_id);
  if (worker == nullptr || !worker->is_working()) return;
  for (const auto& [other, waiting] : waiting_) {
    if (other == owner || !waiting.since || changed_.count(other) > 0) continue;
    if (now - *waiting.since < policy_.share.max_wait || *waiting.since >= since) continue;
    const auto runnable = runnable_.find(other);
    if (runnable == runnable_.end()) continue;
    const std::set<JobKey>& before = waiting.jobs;
    const bool is_free =
        std::any_of(runnable->second.begin(), runnable->second.end(), [&](JobKey job) {
          const auto held = worker->leased_units.lower_bound({job, {}});
          const bool holds_some = held != worker->leased_units.end() && held->first == job;
          return before.count(job) > 0 && !holds_some && holds_.count({grant.worker_id, job}) == 0;
        });
    if (!is_free) continue;
    violate(absl::StrCat(grant.worker_id, " is leased units of ", owner, ", while ", other,
                         " has waited for ", seconds(now - *waiting.since), " s"));
  }
}

/// Notes that the order of shares has chosen the owner.
void FairnessChecks::note_order(const Grant& grant, const std::string& owner, Time now) {
  const auto own = waiting_.find(owner);
  const bool is_known = own == waiting_.end() || own->second.since.has_value();
  const bool is_overdue =
      !is_known || (own != waiting_.end() && now - *own->second.since >= policy_.share.max_wait);
  events_.overdue_leases += is_known && is_overdue ? 1 : 0;
  const auto last = last_job_.find(grant.worker_id);
  const bool has_changed =
      last == last_job_.end() || (last->second.has_value() && *last->second != grant.lease.job_id);
  for (auto it = windows_.begin(); it != windows_.end();) {
    const bool is_first = it->first.first == owner, is_second = it->first.second == owner;
    if ((is_first || is_second) && is_overdue) {
      it = windows_.erase(it);
      continue;
    }
    if (is_first && has_changed) it->second.is_first_in_order = true;
    if (is_second && has_changed) it->second.is_second_in_order = true;
    ++it;
  }
}

void FairnessChecks::check_grant(const FarmView& farm, const Grant& grant, Time now) {
  const Job* job = farm.find_job(grant.lease.job_id);
  if (job == nullptr) return;  // removed in this step: its owner has changed it
  if (is_apart(*job, grant.lease)) return;
  const std::string& owner = job->spec->owner;
  const auto own = waiting_.find(owner);
  if (is_unclear(*job, grant.lease)) {
    changed_.insert(owner);
    return;
  }
  ++events_.leases;
  check_order(farm, grant, owner, now);
  note_order(grant, owner, now);
  last_job_[grant.worker_id] = grant.lease.job_id;
  if (own != waiting_.end()) own->second.since = now;
}

void FairnessChecks::update_waits(const std::set<std::string>& doubtful, Time now) {
  std::erase_if(waiting_, [&](const auto& entry) {
    return runnable_.count(entry.first) == 0 && doubtful.count(entry.first) == 0;
  });
  for (const auto& [owner, jobs] : runnable_) waiting_.try_emplace(owner, Waiting{now, {}});
  for (const std::string& owner : doubtful) waiting_[owner].since.reset();
  for (const std::string& owner : changed_) {
    const auto waiting = waiting_.find(owner);
    if (waiting != waiting_.end() && waiting->second.since != now) waiting->second.since.reset();
  }
  changed_.clear();
  for (auto& [owner, waiting] : waiting_) waiting.jobs = runnable_[owner];
}

/// A worker with credits must not lack units while one waits that it may render.
void FairnessChecks::check_idle(const FarmView& farm, Time now) {
  // Until then the server may wait for workers that it knew before its start.
  const bool is_quiet = now - quiet_since_ > policy_.restart_grace + policy_.timer_slack;
  std::map<std::pair<std::string, JobKey>, int> idle;
  std::set<std::pair<std::string, JobKey>> holds;
  for (const auto& [key, worker] : farm.scheduler().workers().all()) {
    for (const auto& [job, unit] : worker.leased_units) holds.insert({worker.id, job});
    if (!is_quiet || !worker.is_working() || worker.credits <= 0) continue;
    for (const auto& [owner, jobs] : runnable_) {
      for (const JobKey job : jobs) {
        const std::pair both{worker.id, job};
        if (holds.count(both) > 0 || holds_.count(both) > 0) continue;
        const auto before = idle_.find(both);
        idle[both] = before == idle_.end() ? 1 : before->second + 1;
        if (idle[both] <= kIdleSteps) continue;
        violate(absl::StrCat(worker.id, " has ", worker.credits,
                             " credits and is leased nothing of job ", job));
      }
    }
  }
  idle_ = std::move(idle);
  holds_ = std::move(holds);
}

/// Compares the use of each two owners in a window with what the order of shares allows.
void FairnessChecks::check_windows(Time now) {
  for (auto one = use_.begin(); one != use_.end(); ++one) {
    for (auto other = std::next(one); other != use_.end(); ++other) {
      const auto& [a, first] = *one;
      const auto& [b, second] = *other;
      if (!first.priority || first.priority != second.priority) {
        windows_.erase({a, b});
        continue;
      }
      Window& window = windows_[{a, b}];
      if (!window.is_first_in_order || !window.is_second_in_order) continue;
      const double used = (first.committed + first.leased * scale(now)) / weight(a);
      const double other_used = (second.committed + second.leased * scale(now)) / weight(b);
      const double difference = used - other_used;
      window.min = std::min(window.min.value_or(difference), difference);
      window.max = std::max(window.max.value_or(difference), difference);
      // Units that workers hold, bring back or deliver late, and one more unit for each worker.
      const double outstanding = (3 * workers_.credit_count + workers_.count) * unit_seconds_;
      const double allowed = outstanding * (1 / weight(a) + 1 / weight(b)) * scale(now);
      const double sum = used + other_used;
      if (!window.start) window.start = sum;
      if (std::isfinite(*window.start) && sum - *window.start > 2 * allowed) {
        ++events_.share_windows;  // once
        window.start = HUGE_VAL;
      }
      if (*window.max - *window.min <= allowed) continue;
      violate(absl::StrCat("the use per weight of ", a, " and ", b, " diverges by ",
                           *window.max - *window.min, " s of at most ", allowed));
    }
  }
}

std::string FairnessChecks::check(const FarmView& farm, Time now) {
  bool is_complete = false;
  const std::vector<Grant> grants = take_grants(farm, is_complete);
  const std::set<std::string> doubtful = observe(farm, now);
  if (!is_complete) {
    for (auto& [owner, waiting] : waiting_) waiting.since.reset();
    for (auto& [worker, job] : last_job_) job.reset();
    windows_.clear();
  }
  for (const Grant& grant : grants) check_grant(farm, grant, now);
  update_waits(doubtful, now);
  check_idle(farm, now);
  check_windows(now);
  const Duration turns = workers_.longest_turn * (static_cast<int>(waiting_.size()) + 1);
  const Duration limit = policy_.share.max_wait + turns;
  for (const auto& [owner, waiting] : waiting_) {
    if (!calm_since_ || now - *calm_since_ < limit || !waiting.since) continue;
    if (now - *waiting.since <= limit) continue;
    violate(absl::StrCat(owner, " has waited for ", seconds(now - *waiting.since), " s"));
  }
  return violation_;
}

}  // namespace tessera::server
