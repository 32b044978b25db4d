#include "server/schedule/leasing/tail_balance.h"

#include <algorithm>

namespace tessera::server {

using contract::Unit;

void TailBalance::balance_tail(Time now) {
  if (counts_.idle().empty() || ready_.tail().empty() || absences_.has_missing()) return;
  std::vector<Worker*> idle = idle_workers();
  if (idle.empty()) return;
  copy_slow_units(idle, now);
  std::int32_t wanted = 0;
  for (const Worker* worker : idle) {
    wanted += std::min(worker->credits, worker->thread_count -
                                            static_cast<std::int32_t>(worker->leased_units.size()));
  }
  if (wanted > 0) steal_unstarted(wanted);
}

std::vector<Worker*> TailBalance::idle_workers() {
  std::vector<Worker*> idle;
  for (const auto& [load, key] : counts_.idle()) {
    if (load >= 1) break;  // they have a unit for each thread
    idle.push_back(&workers_.at(key));
  }
  return idle;
}

void TailBalance::copy_slow_units(std::vector<Worker*>& idle, Time now) {
  for (const JobKey key : ready_.tail()) {
    Job& job = jobs_.at(key);
    std::vector<Unit> slow;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      const Holder& holder = in_flight.holders.front();
      if (in_flight.copied || in_flight.holders.size() > 1 || !holder.started) continue;
      const auto& pass = job.plan->shape().passes[static_cast<std::size_t>(unit.pass)];
      const auto median = job.times.median(pass.sample_count);
      if (median && seconds(now - *holder.started) > 2 * *median) slow.push_back(unit);
    }
    for (const Unit& unit : slow) {
      const auto taker = std::find_if(idle.begin(), idle.end(), [&](const Worker* worker) {
        const WorkerKey holder = job.plan->find_in_flight(unit)->holders.front().worker;
        return worker->key != holder && worker->credits > 0 && choice_.may_work_for(*worker, job) &&
               choice_.may_take(*worker, job, unit) &&
               static_cast<std::int32_t>(worker->leased_units.size()) < worker->thread_count;
      });
      if (taker == idle.end()) continue;
      grants_.lease(job, **taker, Run{unit.frame, unit.pass, unit.tile, 1}, now);
      job.plan->find_in_flight(unit)->copied = true;
    }
  }
}

/// Has workers give back units that they have not begun, for idle ones; each keeps one per thread,
/// whatever jobs its units belong to.
void TailBalance::steal_unstarted(std::int32_t wanted) {
  std::map<WorkerKey, std::int32_t> surplus;
  for (const JobKey key : ready_.tail()) {
    const Job& job = jobs_.at(key);
    for (const auto& [holder, count] : job.holders) {
      const Worker& worker = workers_.at(holder);
      surplus.try_emplace(
          holder, static_cast<std::int32_t>(worker.leased_units.size()) - worker.thread_count);
    }
    for (const auto& [unit, in_flight] : job.plan->in_flight()) {
      if (!in_flight.holders.front().revoking) continue;  // it is being given back
      --wanted;
      --surplus[in_flight.holders.front().worker];
    }
  }
  for (const JobKey key : ready_.tail()) {
    Job& job = jobs_.at(key);
    std::vector<Unit> units;
    for (const auto& [unit, in_flight] : job.plan->in_flight()) units.push_back(unit);
    for (auto unit = units.rbegin(); unit != units.rend() && wanted > 0; ++unit) {
      InFlight& in_flight = *job.plan->find_in_flight(*unit);
      Holder& holder = in_flight.holders.front();
      if (in_flight.holders.size() > 1 || holder.started || holder.revoking) continue;
      if (surplus[holder.worker] <= 0) continue;
      --surplus[holder.worker];
      --wanted;
      holder.revoking = true;
      outgoing_.revoke(workers_.at(holder.worker), job, *unit);
    }
  }
}

}  // namespace tessera::server
