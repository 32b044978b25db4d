#include "server/telemetry/labelled_gauges.h"

#include <utility>

namespace tessera::server {

void LabelledGauges::set(const std::map<std::string, double>& values) {
  const MutexLock lock(mutex_);
  std::map<std::string, prometheus::Gauge*> next;
  for (const auto& [name, value] : values) {
    if (next.size() == kMaxLabels) break;
    const auto found = gauges_.find(name);
    prometheus::Gauge* gauge =
        found != gauges_.end() ? found->second : &family_.Add({{label_, name}});
    gauge->Set(value);
    next[name] = gauge;
  }
  for (const auto& [name, gauge] : gauges_) {
    if (next.count(name) == 0) family_.Remove(gauge);
  }
  gauges_ = std::move(next);
}

}  // namespace tessera::server
