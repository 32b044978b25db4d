#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "server/queries/farm_queries.h"

namespace tessera::server {
namespace {

/// Units for which one more worker is useful: those per pod of the example of an autoscaler
/// (deploy/kubernetes/autoscaled).
constexpr std::int64_t kUnitsPerWorker = 32;

/// Values of the gauges, from one pass over jobs and workers. Jobs may change during it.
struct Census {
  explicit Census(Limits limits) : room(std::move(limits)) {}

  std::array<std::int64_t, 6> jobs{};         // by JobState − 1
  std::array<std::int64_t, 3> paused_jobs{};  // by PauseCause − 1
  std::int64_t waiting = 0, blocked = 0, paused = 0, leased = 0, committed = 0;
  std::int64_t working = 0, draining = 0, quarantined = 0, set_aside = 0, disconnected = 0,
               lost = 0, left = 0, threads = 0;

  std::map<std::string, double> pool_waiting, pool_oldest, pool_threads;  // by pool
  std::map<std::string, double> limit_units, limit_used;                  // by limit
  std::map<std::string, double> for_new_workers = {{new_workers_key("", ""), 0}};
  Limits room;  // with the units that are counted for new workers

  void add(const FarmView& farm, const Job& job) {
    const Scheduler& scheduler = farm.scheduler();
    ++jobs[static_cast<std::size_t>(job.state) - 1];
    if (job.state == JobState::paused) {
      ++paused_jobs[static_cast<std::size_t>(farm.pause_cause(job)) - 1];
    }
    if (has_ended(job.state)) return;
    const std::int64_t total = job.plan ? job.plan->counts().planned : job.unit_count;
    const std::int64_t done = job.plan ? job.plan->counts().committed : 0;
    const std::int64_t in_flight = job.plan ? job.plan->counts().in_flight : 0;
    committed += done;
    leased += in_flight;
    const std::int64_t rest = total - done - in_flight;
    if (job.state == JobState::paused) {
      paused += rest;
      return;
    }
    const std::int64_t open = leasable(job, rest);
    waiting += open;
    blocked += rest - open;
    if (open == 0 || scheduler.limits().table().room(job.spec->limits) == 0) return;
    add_for_new_workers(job, open);
    const std::string pool = job.spec->pool.empty() ? kDefaultPool : job.spec->pool;
    pool_waiting[pool] += static_cast<double>(open);
    double& oldest = pool_oldest[pool];
    if (job.waiting_since) oldest = std::max(oldest, seconds(farm.now() - *job.waiting_since));
  }
  /// Counts those of the `open` units that workers could take which connect now, beside the present
  /// ones.
  void add_for_new_workers(const Job& job, std::int64_t open) {
    const JobSpec& spec = *job.spec;
    std::int64_t units = job.lost_asset.empty() ? std::min(open, room.room(spec.limits)) : 0;
    if (spec.max_workers > 0) {
      const auto holders = static_cast<std::int64_t>(job.holders.size());
      const std::int64_t further = std::max<std::int64_t>(spec.max_workers - holders, 0);
      units = std::min(units, further * kUnitsPerWorker);
    }
    room.take(spec.limits, units);  // other jobs may name the same limits
    for_new_workers[new_workers_key(spec.pool, spec.required_tag)] += static_cast<double>(units);
  }
  /// Tag and pool as FarmMetrics::Pools::units_for_new_workers has them. Without a tag first, so
  /// that clients cannot displace these with tags of their own.
  static std::string new_workers_key(const std::string& pool, const std::string& tag) {
    return tag + "\n" + (pool.empty() ? kDefaultPool : pool);
  }
  /// Returns how many of the units that are not leased no other job blocks.
  static std::int64_t leasable(const Job& job, std::int64_t rest) {
    if (!job.is_runnable()) return 0;
    if (job.plan) return job.plan->counts().waiting;
    const auto blocked_frames = static_cast<std::int64_t>(job.blocked_frames.size());
    return rest - rest / std::max(job.frame_count, 1) * blocked_frames;
  }
  void add(const Limits& limits) {
    for (const auto& [name, limit] : limits.all()) {
      if (!limit.units) continue;
      limit_units[name] = static_cast<double>(*limit.units);
      limit_used[name] = static_cast<double>(limit.used);
    }
  }
  void add(const Worker& worker) {
    if (worker.is_working()) {
      ++working;
      threads += worker.thread_count;
      pool_threads[worker.pool] += worker.thread_count;
      for_new_workers.try_emplace(new_workers_key(worker.pool, ""), 0);
    } else if (worker.quarantined) {
      ++quarantined;
    } else if (worker.left) {
      ++left;
    } else if (worker.lost) {
      ++lost;
    } else if (worker.connected && worker.set_aside) {
      ++set_aside;
    } else {
      ++(worker.connected ? draining : disconnected);
    }
  }
};

constexpr int kJobsAtOnce = 1000;

/// Adds a thousand jobs, from the key `first`. Returns the key of the next one, or -1. Not all at
/// once, because 100,000 jobs would lock the farm for 20 ms.
JobKey add_jobs(const FarmState& farm, JobKey first, Census& census) {
  const FarmView view(farm);
  const auto& jobs = view.scheduler().jobs().all();
  auto job = jobs.lower_bound(first);
  for (int count = 0; job != jobs.end() && count < kJobsAtOnce; ++job, ++count) {
    census.add(view, job->second);
  }
  return job == jobs.end() ? -1 : job->first;
}

/// Returns for each client the used fraction of the quota that is closest to its limit.
std::map<std::string, double> used_fractions(const ClientQuotas& quotas,
                                             const std::map<std::string, OwnerUse>& uses) {
  std::map<std::string, double> fractions;
  for (const auto& [client, use] : uses) {
    double& fraction = fractions[client];
    for (const QuotaKind& kind : kQuotaKinds) {
      const double limit = quotas.of(client).*kind.member;
      if (limit > 0) fraction = std::max(fraction, use.of(kind) / limit);
    }
  }
  return fractions;
}

}  // namespace

std::vector<prometheus::MetricFamily> FarmQueries::metrics() const {
  FarmMetrics& metrics = parts_.farm.metrics();
  Census census([this] {
    const FarmView view(parts_.farm);
    return view.scheduler().limits().table();
  }());
  for (JobKey next = 0; next >= 0;) next = add_jobs(parts_.farm, next, census);
  {
    const FarmView view(parts_.farm);
    census.add(view.scheduler().limits().table());
    for (const auto& [key, worker] : view.scheduler().workers().all()) census.add(worker);
  }
  const auto set = [](prometheus::Gauge& gauge, auto value) {
    gauge.Set(static_cast<double>(value));
  };
  for (std::size_t i = 0; i < census.jobs.size(); ++i) set(*metrics.jobs[i], census.jobs[i]);
  set(metrics.units.waiting, census.waiting);
  set(metrics.units.blocked, census.blocked);
  set(metrics.units.paused, census.paused);
  set(metrics.units.leased, census.leased);
  set(metrics.units.committed, census.committed);
  set(metrics.workers.working, census.working);
  set(metrics.workers.draining, census.draining);
  set(metrics.workers.quarantined, census.quarantined);
  set(metrics.workers.set_aside, census.set_aside);
  set(metrics.workers.disconnected, census.disconnected);
  set(metrics.workers.lost, census.lost);
  set(metrics.workers.left, census.left);
  set(metrics.worker_threads, census.threads);
  // A pool that has only workers, or only jobs, has all three.
  for (const auto& [pool, count] : census.pool_threads) {
    census.pool_waiting.try_emplace(pool, 0);
    census.pool_oldest.try_emplace(pool, 0);
  }
  for (const auto& [pool, count] : census.pool_waiting) census.pool_threads.try_emplace(pool, 0);
  metrics.pools.units_waiting.set(census.pool_waiting);
  metrics.pools.units_for_new_workers.set(census.for_new_workers);
  metrics.pools.oldest_wait_seconds.set(census.pool_oldest);
  metrics.pools.worker_threads.set(census.pool_threads);
  metrics.limits.units.set(census.limit_units);
  metrics.limits.used_units.set(census.limit_used);
  for (std::size_t i = 0; i < census.paused_jobs.size(); ++i) {
    set(*metrics.paused_jobs[i], census.paused_jobs[i]);
  }
  std::map<std::string, double> used;
  for (const auto& [account, state] : parts_.budgets.list("")) {
    used[account_text(account)] = state.used_cpu_seconds / state.budget.cpu_seconds;
  }
  metrics.budget_used_fraction.set(used);
  metrics.quota_used_fraction.set(used_fractions(parts_.farm.options().client_quotas, quota_use()));
  set(metrics.ingest_bytes, parts_.budget.used_bytes());
  set(metrics.film_queue_length, parts_.finisher.tasks().size());
  set(metrics.film_bytes, parts_.finisher.films().cache().used_bytes());
  set(metrics.store_bytes, parts_.store.used_bytes());
  set(metrics.store_free_bytes, parts_.store.free_bytes());
  set(metrics.store_quota_bytes, parts_.farm.options().quota_bytes);
  return metrics.collect();
}

}  // namespace tessera::server
