#include "worker/agent/units/agent_metrics.h"

#include <string>

#include "telemetry/registry/families.h"

namespace tessera::agent {
namespace {

using metrics::counter;
using metrics::counters;
using metrics::gauge;
using metrics::gauges;
using metrics::histogram;
using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;
using prometheus::Registry;

/// Returns bucket bounds in seconds: units and scenes take from milliseconds to hours.
Histogram::BucketBoundaries bounds() {
  return {0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 1000, 10000};
}

AgentMetrics::Units unit_gauges(Registry& registry) {
  Family<Gauge>& family =
      gauges(registry, "tessera_worker_units", "Units leased to this worker and not acknowledged");
  const auto add = [&](const char* state) -> Gauge& { return family.Add({{"state", state}}); };
  return {add("waiting"), add("started"), add("unacknowledged")};
}

std::array<Counter*, 4> acknowledgement_counters(Registry& registry) {
  Family<Counter>& family = counters(registry, "tessera_worker_acknowledgements_total",
                                     "Acknowledgements of this worker's results");
  const auto add = [&](const char* status) { return &family.Add({{"status", status}}); };
  return {add("committed"), add("duplicate"), add("obsolete"), add("rejected")};
}

AgentMetrics::Errors error_counters(Registry& registry) {
  Family<Counter>& family =
      counters(registry, "tessera_worker_errors_total", "Recoverable errors, by kind");
  const auto add = [&](const char* kind) -> Counter& { return family.Add({{"kind", kind}}); };
  return {add("unit_failed"), add("renderer_died"), add("asset_failed")};
}

AgentMetrics::Assets asset_counters(Registry& registry) {
  Family<Counter>& family =
      counters(registry, "tessera_worker_assets_total", "Scene files that jobs needed, by source");
  return {family.Add({{"source", "cache"}}), family.Add({{"source", "server"}})};
}

}  // namespace

AgentMetrics::AgentMetrics()
    : units(unit_gauges(registry_)),
      threads(gauge(registry_, "tessera_worker_render_threads",
                    "Maximum number of units rendered at once")),
      connected(gauge(registry_, "tessera_worker_connected", "1 while connected to a server")),
      ack_latency_seconds(
          gauge(registry_, "tessera_worker_ack_latency_seconds",
                "Recent minimum latency from offering a block to its acknowledgement")),
      resident_bytes(gauge(registry_, "tessera_worker_resident_bytes",
                           "Memory of the worker and its renderer")),
      acknowledgements(acknowledgement_counters(registry_)),
      errors(error_counters(registry_)),
      assets(asset_counters(registry_)),
      asset_bytes(counter(registry_, "tessera_worker_asset_bytes_total",
                          "Scene files downloaded from the server")),
      block_bytes(counter(registry_, "tessera_worker_block_bytes_total", "Film blocks rendered")),
      cpu_seconds(
          counter(registry_, "tessera_worker_cpu_seconds_total", "CPU time of rendered units")),
      unit_seconds(histogram(registry_, "tessera_worker_unit_seconds",
                             "Wall time of a unit on its thread", bounds())),
      scene_load_seconds(histogram(registry_, "tessera_worker_scene_load_seconds",
                                   "Time to load a frame's scene and build its structures",
                                   bounds())) {}

}  // namespace tessera::agent
