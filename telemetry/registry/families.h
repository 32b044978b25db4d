#pragma once

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <string>

namespace tessera::metrics {

// Registers metrics in `registry`, which owns them. The plural functions return a family, to which
// the caller adds a metric per label value; the others return one metric without labels.

inline prometheus::Family<prometheus::Counter>& counters(prometheus::Registry& registry,
                                                         const std::string& name,
                                                         const std::string& help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry);
}

inline prometheus::Family<prometheus::Gauge>& gauges(prometheus::Registry& registry,
                                                     const std::string& name,
                                                     const std::string& help) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(registry);
}

inline prometheus::Counter& counter(prometheus::Registry& registry, const std::string& name,
                                    const std::string& help) {
  return counters(registry, name, help).Add({});
}

inline prometheus::Gauge& gauge(prometheus::Registry& registry, const std::string& name,
                                const std::string& help) {
  return gauges(registry, name, help).Add({});
}

/// `bounds`: upper bounds of the buckets, ascending.
inline prometheus::Histogram& histogram(prometheus::Registry& registry, const std::string& name,
                                        const std::string& help,
                                        const prometheus::Histogram::BucketBoundaries& bounds) {
  return prometheus::BuildHistogram().Name(name).Help(help).Register(registry).Add({}, bounds);
}

}  // namespace tessera::metrics
