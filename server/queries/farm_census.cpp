#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/queries/farm_queries.h"

namespace tessera::server {
namespace {

/// Values of the gauges, from one pass over jobs and workers.
struct Census {
  std::array<std::int64_t, 6> jobs{};  // by JobState − 1
  std::int64_t waiting = 0, paused = 0, leased = 0, committed = 0;
  std::int64_t working = 0, draining = 0, quarantined = 0, disconnected = 0, lost = 0, threads = 0;

  void add(const Job& job) {
    ++jobs[static_cast<std::size_t>(job.state) - 1];
    if (has_ended(job.state)) return;
    const std::int64_t total = job.plan ? job.plan->unit_count() : job.unit_count;
    const std::int64_t done = job.plan ? job.plan->committed_count() : 0;
    const std::int64_t in_flight = job.plan ? job.plan->in_flight_count() : 0;
    committed += done;
    leased += in_flight;
    (job.state == JobState::paused ? paused : waiting) += total - done - in_flight;
  }
  void add(const Worker& worker) {
    if (worker.is_working()) {
      ++working;
      threads += worker.thread_count;
    } else if (worker.quarantined) {
      ++quarantined;
    } else if (worker.lost) {
      ++lost;
    } else {
      ++(worker.connected ? draining : disconnected);
    }
  }
};

}  // namespace

std::vector<prometheus::MetricFamily> FarmQueries::metrics() const {
  FarmMetrics& metrics = parts_.farm.metrics();
  Census census;
  {
    const FarmView view(parts_.farm);
    for (const auto& [key, job] : view.scheduler().jobs()) census.add(job);
    for (const auto& [key, worker] : view.scheduler().workers()) census.add(worker);
  }
  const auto set = [](prometheus::Gauge& gauge, auto value) {
    gauge.Set(static_cast<double>(value));
  };
  for (std::size_t i = 0; i < census.jobs.size(); ++i) set(*metrics.jobs[i], census.jobs[i]);
  set(metrics.units.waiting, census.waiting);
  set(metrics.units.paused, census.paused);
  set(metrics.units.leased, census.leased);
  set(metrics.units.committed, census.committed);
  set(metrics.workers.working, census.working);
  set(metrics.workers.draining, census.draining);
  set(metrics.workers.quarantined, census.quarantined);
  set(metrics.workers.disconnected, census.disconnected);
  set(metrics.workers.lost, census.lost);
  set(metrics.worker_threads, census.threads);
  set(metrics.ingest_bytes, parts_.budget.used_bytes());
  set(metrics.film_queue_length, parts_.finisher.tasks().size());
  set(metrics.film_bytes, parts_.finisher.films().cache().used_bytes());
  set(metrics.store_bytes, parts_.store.used_bytes());
  return metrics.collect();
}

}  // namespace tessera::server
