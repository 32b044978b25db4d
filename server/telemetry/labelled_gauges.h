#pragma once

#include <prometheus/family.h>
#include <prometheus/gauge.h>

#include <map>
#include <string>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Gauges of one metric whose label takes any value, such as the name of a pool. Thread-safe.
class LabelledGauges {
 public:
  static constexpr std::size_t kMaxLabels = 200;

  LabelledGauges(prometheus::Family<prometheus::Gauge>& family, std::string label)
      : family_(family), label_(std::move(label)) {}

  /// Replaces all gauges by these, at most kMaxLabels of them: clients choose names.
  void set(const std::map<std::string, double>& values);

 private:
  prometheus::Family<prometheus::Gauge>& family_;
  const std::string label_;
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::map<std::string, prometheus::Gauge*> gauges_
      ABSL_GUARDED_BY(mutex_);  // by value of the label
};

}  // namespace tessera::server
