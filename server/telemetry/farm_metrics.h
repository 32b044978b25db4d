#pragma once

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <cstddef>
#include <vector>

#include "server/schedule/worker.h"

namespace tessera::server {

/// What a server counts and measures, by the names Prometheus reads. Totals begin with the process;
/// times are in seconds. Thread-safe.
class FarmMetrics {
 private:
  prometheus::Registry registry_;  // owns all that follows

 public:
  FarmMetrics();

  // Counted and timed as it happens.
  prometheus::Counter &units_committed, &samples, &block_bytes, &cpu_seconds;
  std::array<prometheus::Counter*, 4> acknowledgements;  // by AckStatus − 1
  prometheus::Counter &audits_ended, &results_mismatched, &workers_quarantined;
  /// What failed while the farm went on.
  struct Errors {
    prometheus::Counter &unit_failed, &worker_lost, &block_rejected, &commit, &journal, &film;
  } errors;
  struct FilmBlocks {
    prometheus::Counter &delivered, &read_back;
  } film_blocks;  // merged as they came (the cache's hits), or read from the store (its misses)
  prometheus::Histogram &unit_turnaround_seconds, &commit_seconds, &fsync_seconds, &merge_seconds,
      &frame_write_seconds;

  // Set by the coordinator when they are asked for.
  struct Units {
    prometheus::Gauge &waiting, &paused, &leased, &committed;
  } units;
  std::array<prometheus::Gauge*, 6> jobs;  // by JobState − 1
  struct Workers {
    prometheus::Gauge &working, &draining, &quarantined, &disconnected, &lost;
  } workers;  // away: without a stream, and silent for less than the time-out
  prometheus::Gauge &worker_threads, &ingest_bytes, &film_bytes, &film_queue_length, &store_bytes;

  prometheus::Counter& acknowledgement(AckStatus status) {
    return *acknowledgements[static_cast<std::size_t>(status) - 1];
  }
  std::vector<prometheus::MetricFamily> collect() const { return registry_.Collect(); }
};

}  // namespace tessera::server
