// Faults of a simulated farm, and its rules of dependencies and limits.
#include <algorithm>
#include <chrono>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/schedule/simulation/simulated_farm_parts.h"

namespace tessera::server {
namespace {

constexpr int kMaxJobs = 12;

bool has_other_holder(const Job& job, const contract::Unit& unit, WorkerKey worker) {
  if (!job.plan) return false;
  const auto found = job.plan->in_flight().find(unit);
  if (found == job.plan->in_flight().end()) return false;
  const std::vector<Holder>& holders = found->second.holders;
  return std::any_of(holders.begin(), holders.end(),
                     [worker](const Holder& holder) { return holder.worker != worker; });
}

}  // namespace

// Dependencies and limits -------------------------------------------------------------------------

/// Lets the job wait for up to two others.
void SimulatedFarm::add_dependencies(JobSpec& spec) {
  const int count = 1 + dice_.below(2);
  for (int i = 0; i < count; ++i) {
    const auto other = store_.find(1 + dice_.below(static_cast<int>(last_job_)));
    if (other == store_.end()) continue;
    const auto kind = static_cast<Dependency::Kind>(1 + dice_.below(3));
    const JobSpec& named = *other->second->spec;
    const bool lacks_frames = named.settings.frames[0].last < spec.settings.frames[0].last;
    if (kind == Dependency::Kind::frames && lacks_frames) continue;
    spec.after.push_back({named.id, kind});
  }
}

/// Returns whether a job with this dependency may have this lease.
bool SimulatedFarm::is_met(const Dependency& dependency, const Lease& lease) const {
  const auto removed = removed_.find(dependency.job_id);
  const Job* other = scheduler_->jobs().find(dependency.job_id);
  const JobState state = removed != removed_.end() ? removed->second : other->state;
  if (state == JobState::done) return true;
  switch (dependency.kind) {
    case Dependency::Kind::success:
      return false;
    case Dependency::Kind::end: {
      const auto retried = retried_since_.find(dependency.job_id);
      return has_ended(state) ||
             (retried != retried_since_.end() && lease.attempt <= retried->second);
    }
    case Dependency::Kind::frames:
      return other != nullptr && store_.at(other->key)->frames.count(lease.frame) > 0;
  }
  return false;
}

/// Returns the newest lease that was granted.
Attempt SimulatedFarm::newest_lease() const {
  Attempt newest = last_lease_;
  for (const auto& [key, worker] : scheduler_->workers().all()) {
    for (const Lease& lease : worker.outbox.leases) newest = std::max(newest, lease.attempt);
  }
  return newest;
}

/// Checks a lease when its worker reads it. It may be older than a rule.
void SimulatedFarm::check_lease(const Computer& computer, const Job& job, const Lease& lease) {
  const contract::Unit unit{lease.frame, lease.first_tile, lease.pass};
  const bool is_audit = job.plan && job.plan->is_committed(unit);
  for (const Dependency& dependency : job.spec->after) {
    if (is_met(dependency, lease)) continue;
    // Units that were leased before that job was retried may be audited and copied.
    const bool is_repeated = is_audit || has_other_holder(job, unit, computer.key);
    if (is_repeated && retried_since_.count(dependency.job_id) > 0) continue;
    violate(absl::StrCat("job ", lease.job_id, " is leased before job ", dependency.job_id));
  }
  if (aside_.count(computer.id) > 0 && lease.attempt > aside_since_.at(computer.id)) {
    violate(absl::StrCat(computer.id, " is set aside"));
  }
  if (job.spec->blocked_workers.count(computer.id) > 0 &&
      lease.attempt > blocked_since_.at({job.key, computer.id})) {
    violate(absl::StrCat(computer.id, " is blocked for job ", lease.job_id));
  }
  const Worker* worker = scheduler_->workers().find(computer.key);
  const bool is_held = worker != nullptr && worker->leased_units.count({job.key, unit}) > 0;
  const Account account{AccountScope::owner, job.spec->owner};
  if (stopped_.count(account) > 0 && lease.attempt > stopped_since_.at(account) && is_held &&
      !is_audit) {
    violate(absl::StrCat("the budget of ", job.spec->owner, " is used up"));
  }
}

/// Lets what workers brought back, and what was leased before a limit was lowered, run out.
void SimulatedFarm::check_limits() {
  const std::int64_t used = scheduler_->limits().table().all().at(kLimit).used;
  events_.full_limits += used == limit_ ? 1 : 0;
  if (used > std::max(limit_, excess_)) {
    violate(absl::StrCat(used, " units of a limit of ", limit_, " are in use"));
  }
  excess_ = std::min(excess_, std::max(limit_, used));
}

void SimulatedFarm::retry(Job& job) {
  retried_since_[job.spec->id] = newest_lease();
  if (!scheduler_->lifecycle().retry(job, now_).ok()) violate("cannot retry");
  finish_frames(job);
}

/// Ends what would keep jobs from being done: pauses, jobs that others wait for and that were
/// cancelled, jobs that others wait for and that are gone.
void SimulatedFarm::resume_all() {
  stopped_.clear();
  scheduler_->limits().stop_accounts(stopped_, now_);
  for (const auto& [key, stored] : store_) {
    Job& job = *scheduler_->jobs().find(key);
    if (job.state != JobState::done && !scheduler_->dependencies().check_possible(job).ok()) {
      ++events_.impossible;
      auto spec = std::make_shared<JobSpec>(*job.spec);
      spec->after.clear();
      stored->spec = spec;
      scheduler_->changes().change(job, spec, now_);
    }
    if (job.state == JobState::paused) scheduler_->lifecycle().resume(job, now_).IgnoreError();
    if (job.state == JobState::cancelled || job.state == JobState::failed) retry(job);
  }
}

// Faults ------------------------------------------------------------------------------------------

void SimulatedFarm::disturb_jobs() {
  const JobKey key = 1 + dice_.below(static_cast<int>(last_job_));
  Job* job = scheduler_->jobs().find(key);
  if (job == nullptr) return;
  switch (dice_.below(6)) {
    case 4:
      change_job(*job);
      break;
    case 5:
      if (dice_.one_in(5)) scheduler_->lifecycle().cancel(*job, now_).IgnoreError();
      if (has_ended(job->state)) remove_job(key);
      break;
    case 0:
      scheduler_->lifecycle().pause(*job, "asked", now_).IgnoreError();
      break;
    case 1:
    case 2:
      scheduler_->lifecycle().resume(*job, now_).IgnoreError();
      break;
    default:
      if (dice_.one_in(3)) scheduler_->lifecycle().cancel(*job, now_).IgnoreError();
      break;
  }
}

/// Changes the order, the requirements and the limits of a job.
void SimulatedFarm::change_job(Job& job) {
  if (job.state == JobState::done) return;
  auto spec = std::make_shared<JobSpec>(*job.spec);
  spec->priority = dice_.below(5) - 2;
  spec->max_workers = dice_.one_in(3) ? 1 + dice_.below(3) : 0;
  spec->required_tag = kTags[dice_.below(3)];
  spec->pool = kPools[dice_.below(2)];
  spec->limits.clear();
  if (dice_.one_in(2)) spec->limits = {{kLimit, 1 + dice_.below(2)}};
  if (dice_.one_in(4)) spec->after.clear();
  if (dice_.one_in(2)) toggle_block(job.key, *spec);
  store_.at(job.key)->spec = spec;
  scheduler_->changes().change(job, spec, now_);
  if (job.state == JobState::failed && scheduler_->dependencies().check_possible(job).ok()) {
    retry(job);
  }
  excess_ = std::max(excess_, scheduler_->limits().table().all().at(kLimit).used);
}

/// Blocks or unblocks one of the workers that come and go for the job.
void SimulatedFarm::toggle_block(JobKey key, JobSpec& spec) {
  const auto computer =
      std::next(computers_.begin(), dice_.below(static_cast<int>(computers_.size())));
  if (computer->second->is_anchor) return;
  ++events_.blocks;
  blocked_since_[{key, computer->first}] = newest_lease();
  if (spec.blocked_workers.erase(computer->first) == 0) {
    spec.blocked_workers.insert(computer->first);
  }
}

void SimulatedFarm::toggle_aside() {
  const auto computer =
      std::next(computers_.begin(), dice_.below(static_cast<int>(computers_.size())));
  if (computer->second->is_anchor) return;
  ++events_.asides;
  aside_since_[computer->first] = newest_lease();
  if (aside_.erase(computer->first) > 0) {
    scheduler_->orders().bring_back(computer->first, now_);
  } else {
    aside_.insert(computer->first);
    scheduler_->orders().set_aside(computer->first, "", now_);
  }
}

/// Uses up an owner's budget, or raises it.
void SimulatedFarm::toggle_stop() {
  ++events_.stops;
  const Account account{AccountScope::owner, absl::StrCat("owner", dice_.below(4))};
  stopped_since_[account] = newest_lease();
  if (stopped_.erase(account) == 0) stopped_[account] = "used up";
  scheduler_->limits().stop_accounts(stopped_, now_);
}

void SimulatedFarm::remove_job(JobKey key) {
  ++events_.removals;
  removed_[store_.at(key)->spec->id] = scheduler_->jobs().find(key)->state;
  store_.erase(key);
  scheduler_->lifecycle().remove_job(key);
}

void SimulatedFarm::disturb() {
  if (last_job_ < kMaxJobs && dice_.one_in(20)) add_job();
  if (dice_.one_in(40)) disturb_jobs();
  if (computers_.size() < 9 && dice_.one_in(15)) {
    const bool is_faulty = dice_.one_in(3);
    add_computer(is_faulty ? "faulty" : absl::StrCat("honest", dice_.below(4)), is_faulty, false);
  }
  if (dice_.one_in(150)) restart_server();
  if (dice_.one_in(80)) toggle_aside();
  if (dice_.one_in(100)) toggle_stop();
  for (auto& [id, computer] : computers_) {
    if (dice_.one_in(60)) lose_stream(*computer);
    if (computer->is_anchor || !dice_.one_in(80)) continue;
    ++events_.crashes;  // silent, its work is gone; it may come back
    computer->is_up = !computer->is_up;
    computer->tasks.clear();
    lose_stream(*computer);
  }
  if (dice_.one_in(100)) {
    ++events_.moves;
    const auto computer =
        std::next(computers_.begin(), dice_.below(static_cast<int>(computers_.size())));
    if (!computer->second->is_anchor) {
      const std::string pool = dice_.one_in(3) ? "" : dice_.one_in(2) ? "p" : kDefaultPool;
      moved_[computer->first] = pool;
      scheduler_->orders().move(computer->first, pool, now_);
    }
  }
  if (dice_.one_in(100)) {
    limit_ = 2 + dice_.below(4);
    scheduler_->limits().set_limit(kLimit, limit_, now_);
    excess_ = std::max(excess_, scheduler_->limits().table().all().at(kLimit).used);
  }
  if (dice_.one_in(50)) {
    const auto computer =
        std::next(computers_.begin(), dice_.below(static_cast<int>(computers_.size())));
    if (!computer->second->is_anchor && computer->second->is_connected) {
      if (dice_.one_in(2)) scheduler_->orders().drain(computer->first);
      scheduler_->orders().allow(computer->first, now_);
      for (const std::string& name : scheduler_->quarantine().names_to_ban(computer->first)) {
        bans_.erase(name);
      }
    }
  }
}

}  // namespace tessera::server
