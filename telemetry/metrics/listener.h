#pragma once

#include <prometheus/metric_family.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera {

/// Serves GET /metrics over HTTP in Prometheus' text format, and probes, until it is destroyed.
///
/// Listens on loopback addresses only, because it has neither password nor encryption.
class MetricsListener {
 public:
  /// Collects the metrics. Called on a thread of the listener; must return quickly.
  using Collect = std::function<std::vector<prometheus::MetricFamily>()>;
  /// Returns "" if all is well (status 200), else the reason why not (503). Like Collect.
  using Probe = std::function<std::string()>;
  /// Probes of an orchestrator: GET /livez, GET /readyz. Empty: 404.
  struct Probes {
    Probe live, ready;
  };

  /// Starts to listen on HOST:PORT (port 0: any free port).
  ///
  /// Errors: InvalidArgument, the address is invalid or reachable from other machines; Unavailable,
  /// the address cannot be bound.
  static absl::StatusOr<std::unique_ptr<MetricsListener>> start(const std::string& address,
                                                                Collect collect,
                                                                Probes probes = {});
  virtual ~MetricsListener() = default;

  /// HOST:PORT with the bound port.
  virtual const std::string& address() const = 0;
};

}  // namespace tessera
