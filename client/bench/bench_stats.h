#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tessera::client {

/// A render with one seed at one sample count, compared with the reference.
struct BenchPoint {
  double cpu_seconds = 0, relmse = 0;
};

/// Measurements of a scene: `points[s][k]` is for `seeds[s]` at `spp[k]`; counts ascend.
struct SceneBench {
  std::string scene;
  double reference_relmse = 0;  // the reference's own, as estimated in its report
  std::vector<std::int64_t> seeds;
  std::vector<int> spp;
  std::vector<std::vector<BenchPoint>> points;
  /// Mean seconds over seeds of the renders with the most samples: loading, building, wall time to
  /// the first pass and in total, rendering, and the rest of the wall time (journal, merging,
  /// files).
  double load = 0, build = 0, first_pixel = 0, render = 0, wall = 0, rest = 0;
};

/// A value with its interval.
struct Interval {
  double low = 0, value = 0, high = 0;
};

/// Returns median, minimum and maximum of at least one value.
Interval median_and_band(std::vector<double> values);

/// Returns the relMSE below which the reference's own error dominates.
inline double least_relmse(const SceneBench& bench) {
  return 10 * bench.reference_relmse;
}

/// Returns the relMSE at `spp[k]`; null if that of a seed is below least_relmse().
std::optional<Interval> relmse_at(const SceneBench& bench, std::size_t k);

/// Returns the CPU seconds to a relMSE: the median over seeds of curves interpolated in logarithms.
/// Null if a curve does not reach it, or it is below least_relmse().
std::optional<double> seconds_to(const SceneBench& bench, double relmse);

/// Returns 1 / (relMSE * CPU seconds) at the highest count whose errors are all at least
/// least_relmse(): the geometric mean over seeds and its 95 % interval (Student's t of the
/// logarithms; infinite with one seed). Null if there is no such count.
std::optional<Interval> efficiency(const SceneBench& bench);

/// Returns the geometric mean of at least one positive value.
double geometric_mean(std::span<const double> values);

/// Returns a document of schema tessera.bench/1.
nlohmann::ordered_json bench_document(std::span<const SceneBench> scenes);
/// Returns the results as text.
std::string bench_text(std::span<const SceneBench> scenes);

}  // namespace tessera::client
