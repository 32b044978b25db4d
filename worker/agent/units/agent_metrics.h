#pragma once

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <vector>

namespace tessera::agent {

/// Metrics of a worker, under the names of docs/reference/metrics.md. Counters start at 0 with the
/// process; times are in seconds. Thread-safe.
class AgentMetrics {
 private:
  prometheus::Registry registry_;  // owns all metrics

 public:
  AgentMetrics();

  struct Units {
    prometheus::Gauge &waiting, &started, &unacknowledged;
  } units;  // leased units by state
  prometheus::Gauge &threads, &connected, &ack_latency_seconds, &resident_bytes;
  std::array<prometheus::Counter*, 4>
      acknowledgements;  // index: v1::Acknowledgement::AckStatus − 1
  struct Errors {
    prometheus::Counter &unit_failed, &renderer_died, &asset_failed;
  } errors;
  struct Assets {
    prometheus::Counter &cache, &server;
  } assets;  // scene files by source
  prometheus::Counter &asset_bytes, &block_bytes, &cpu_seconds;
  prometheus::Histogram &unit_seconds, &scene_load_seconds;

  std::vector<prometheus::MetricFamily> collect() const { return registry_.Collect(); }
};

}  // namespace tessera::agent
