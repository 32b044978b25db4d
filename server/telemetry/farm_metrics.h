#pragma once

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "server/schedule/workers/worker.h"
#include "server/telemetry/labelled_gauges.h"

namespace tessera::server {

/// The server's metrics (docs/reference/metrics.md). Totals start with the process; times are in
/// seconds. Thread-safe.
class FarmMetrics {
 private:
  prometheus::Registry registry_;  // owns the metrics below

 public:
  FarmMetrics();

  // Recorded when it happens.
  prometheus::Counter &units_committed, &samples, &block_bytes, &cpu_seconds;
  std::array<prometheus::Counter*, 4> acknowledgements;  // by AckStatus − 1
  prometheus::Counter &audits_ended, &results_mismatched, &workers_quarantined;
  /// Recoverable errors, by kind.
  struct Errors {
    prometheus::Counter &unit_failed, &worker_lost, &block_rejected, &commit, &journal, &film;
  } errors;
  struct FilmBlocks {
    prometheus::Counter &delivered, &read_back;
  } film_blocks;  // merged on delivery, or read back from the store
  prometheus::Histogram &unit_turnaround_seconds, &commit_seconds, &fsync_seconds, &merge_seconds,
      &frame_write_seconds;

  // Set by the coordinator before each collection.
  struct Units {
    prometheus::Gauge &waiting, &blocked, &paused, &leased, &committed;
  } units;
  std::array<prometheus::Gauge*, 6> jobs;  // by JobState − 1
  struct Workers {
    prometheus::Gauge &working, &draining, &quarantined, &set_aside, &disconnected, &lost, &left;
  } workers;  // disconnected: without a stream, before the timeout
  prometheus::Gauge &worker_threads, &ingest_bytes, &film_bytes, &film_queue_length, &store_bytes,
      &store_free_bytes, &store_quota_bytes;

  /// By pool: units that a worker of it could be leased now; by required tag and pool, those that
  /// further workers could; by pool, the longest time that a job of it has waited for a lease, and
  /// the threads of its workers.
  struct Pools {
    LabelledGauges units_waiting, units_for_new_workers, oldest_wait_seconds, worker_threads;
  } pools;
  struct LimitGauges {
    LabelledGauges units, used_units;
  } limits;                                       // by name
  LabelledGauges budget_used_fraction;            // by account
  std::array<prometheus::Gauge*, 3> paused_jobs;  // by PauseCause − 1
  /// By client: fraction used of its quota of jobs and files that is closest to its limit.
  LabelledGauges quota_used_fraction;

  /// End of the server's certificate, s since 1970; none without certificates.
  prometheus::Family<prometheus::Gauge>& certificate_expiry;

  /// Requests that were refused, by quota.
  prometheus::Family<prometheus::Counter>& quota_refusals;
  void quota_refused(const std::string& quota) {
    quota_refusals.Add({{"quota", quota}}).Increment();
  }

  prometheus::Counter& acknowledgement(AckStatus status) {
    return *acknowledgements[static_cast<std::size_t>(status) - 1];
  }
  std::vector<prometheus::MetricFamily> collect() const { return registry_.Collect(); }
};

}  // namespace tessera::server
