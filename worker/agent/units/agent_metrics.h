#pragma once

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <vector>

namespace tessera::agent {

/// What a worker counts and measures, by the names Prometheus reads. Totals begin with the process;
/// times are in seconds. Thread-safe.
class AgentMetrics {
 private:
  prometheus::Registry registry_;  // owns all that follows

 public:
  AgentMetrics();

  struct Units {
    prometheus::Gauge &waiting, &started, &unacknowledged;
  } units;  // leased, by what became of them here; held ones wait for their verdict
  prometheus::Gauge &threads, &connected, &ack_latency_seconds, &resident_bytes;
  std::array<prometheus::Counter*, 4> verdicts;  // by v1::Acknowledgement::AckStatus − 1
  struct Errors {
    prometheus::Counter &unit_failed, &renderer_died, &asset_failed;
  } errors;
  struct Assets {
    prometheus::Counter &cache, &server;
  } assets;  // where scene files came from
  prometheus::Counter &asset_bytes, &block_bytes, &cpu_seconds;
  prometheus::Histogram &unit_seconds, &scene_load_seconds;

  std::vector<prometheus::MetricFamily> collect() const { return registry_.Collect(); }
};

}  // namespace tessera::agent
