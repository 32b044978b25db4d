#pragma once

#include <prometheus/metric_family.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera {

/// Answers GET /metrics over HTTP, in Prometheus' text format, until it is destroyed.
///
/// There is no password and no encryption: it listens on loopback addresses only.
class MetricsListener {
 public:
  /// What there is to tell now. Called from a thread of the listener, which it must not keep long.
  using Collect = std::function<std::vector<prometheus::MetricFamily>()>;

  /// Listens on HOST:PORT (port 0: any free one).
  ///
  /// Errors: InvalidArgument, the address can be reached from other machines or is none;
  /// Unavailable, it cannot be bound.
  static absl::StatusOr<std::unique_ptr<MetricsListener>> start(const std::string& address,
                                                                Collect collect);
  virtual ~MetricsListener() = default;

  /// HOST:PORT with the port that was bound.
  virtual const std::string& address() const = 0;
};

}  // namespace tessera
