#pragma once

#include <prometheus/family.h>
#include <prometheus/gauge.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Gauges of one metric whose labels take any values, such as the name of a pool. Thread-safe.
class LabelledGauges {
 public:
  static constexpr std::size_t kMaxLabels = 200;

  LabelledGauges(prometheus::Family<prometheus::Gauge>& family, std::vector<std::string> labels)
      : family_(family), labels_(std::move(labels)) {}

  /// Replaces all gauges by these, by the value of the label, or by the values of the labels with
  /// newlines between them. Only the first kMaxLabels are shown: clients choose names.
  void set(const std::map<std::string, double>& values);

 private:
  prometheus::Labels labels_of(const std::string& values) const;

  prometheus::Family<prometheus::Gauge>& family_;
  const std::vector<std::string> labels_;
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::map<std::string, prometheus::Gauge*> gauges_
      ABSL_GUARDED_BY(mutex_);  // by values of the labels
};

}  // namespace tessera::server
