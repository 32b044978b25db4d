#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tessera::client {

/// A render of one seed at one sample count, against the reference.
struct BenchPoint {
  double cpu_seconds = 0, relmse = 0;
};

/// What one scene gave: `points[s][k]` is `seeds[s]` at `spp[k]`, counts rising.
struct SceneBench {
  std::string scene;
  double reference_relmse = 0;  // the reference's own, as its report estimates it
  std::vector<std::int64_t> seeds;
  std::vector<int> spp;
  std::vector<std::vector<BenchPoint>> points;
  /// Seconds of the renders with most samples, means over seeds: loading and building, wall time to
  /// the first round and in all, rendering, and what of the wall time is none of these (journal,
  /// merging, files).
  double load = 0, build = 0, first_pixel = 0, render = 0, wall = 0, rest = 0;
};

/// An interval around a figure.
struct Interval {
  double low = 0, value = 0, high = 0;
};

/// Median and least and greatest, of at least one value.
Interval median_and_band(std::vector<double> values);

/// Below this a figure would be the reference's error more than ours.
inline double least_relmse(const SceneBench& bench) {
  return 10 * bench.reference_relmse;
}

/// relMSE at `spp[k]`. Null where a seed's is below least_relmse().
std::optional<Interval> relmse_at(const SceneBench& bench, std::size_t k);

/// CPU seconds to a relMSE: each seed's curve interpolated in logarithms, the median over seeds.
/// Null where a curve does not reach it, or it is below least_relmse().
std::optional<double> seconds_to(const SceneBench& bench, double relmse);

/// 1 / (relMSE * CPU seconds) at the last count whose errors are all at least least_relmse(): the
/// geometric mean over seeds and its 95 % interval (Student's t of the logarithms; infinitely wide
/// with one seed). Null where there is no such count.
std::optional<Interval> efficiency(const SceneBench& bench);

/// Of positive values, at least one.
double geometric_mean(std::span<const double> values);

/// The document tessera.bench/1.
nlohmann::ordered_json bench_document(std::span<const SceneBench> scenes);
/// The same for people.
std::string bench_text(std::span<const SceneBench> scenes);

}  // namespace tessera::client
