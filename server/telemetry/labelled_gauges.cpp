#include "server/telemetry/labelled_gauges.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/str_split.h"

namespace tessera::server {

prometheus::Labels LabelledGauges::labels_of(const std::string& values) const {
  if (labels_.size() == 1) return {{labels_.front(), values}};
  const std::vector<std::string> parts = absl::StrSplit(values, '\n');
  prometheus::Labels labels;
  for (std::size_t i = 0; i < std::min(labels_.size(), parts.size()); ++i) {
    labels[labels_[i]] = parts[i];
  }
  return labels;
}

void LabelledGauges::set(const std::map<std::string, double>& values) {
  const MutexLock lock(mutex_);
  std::map<std::string, prometheus::Gauge*> next;
  for (const auto& [name, value] : values) {
    if (next.size() == kMaxLabels) break;
    const auto found = gauges_.find(name);
    prometheus::Gauge* gauge =
        found != gauges_.end() ? found->second : &family_.Add(labels_of(name));
    gauge->Set(value);
    next[name] = gauge;
  }
  for (const auto& [name, gauge] : gauges_) {
    if (next.count(name) == 0) family_.Remove(gauge);
  }
  gauges_ = std::move(next);
}

}  // namespace tessera::server
