#include "client/bench/bench_stats.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/table.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

/// 97.5 % quantiles of Student's t for 1, 2, … degrees of freedom; beyond, the normal distribution.
constexpr double kStudent[] = {12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306,
                               2.262,  2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120,
                               2.110,  2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064,
                               2.060,  2.056, 2.052, 2.048, 2.045, 2.042};

constexpr double kTargets[] = {1e-2, 1e-3, 1e-4};

std::vector<double> column(const SceneBench& bench, std::size_t k, double BenchPoint::*figure) {
  std::vector<double> values;
  values.reserve(bench.points.size());
  for (const std::vector<BenchPoint>& seed : bench.points) values.push_back(seed[k].*figure);
  return values;
}

/// Returns the CPU seconds at which a curve crosses `relmse`; null if it does not.
std::optional<double> crossing(const std::vector<BenchPoint>& curve, double relmse) {
  for (std::size_t k = 1; k < curve.size(); ++k) {
    const BenchPoint &a = curve[k - 1], &b = curve[k];
    if (!(a.relmse >= relmse && b.relmse <= relmse && a.relmse > b.relmse)) continue;
    const double s = std::log(a.relmse / relmse) / std::log(a.relmse / b.relmse);
    return a.cpu_seconds * std::pow(b.cpu_seconds / a.cpu_seconds, s);
  }
  return std::nullopt;
}

/// Returns the highest count at which no error is too close to the reference's own; null if there
/// is none.
std::optional<std::size_t> last_usable(const SceneBench& bench) {
  for (std::size_t k = bench.spp.size(); k-- > 0;) {
    const std::vector<double> errors = column(bench, k, &BenchPoint::relmse);
    const double least = *std::min_element(errors.begin(), errors.end());
    if (least > 0 && least >= least_relmse(bench)) return k;
  }
  return std::nullopt;
}

/// Returns the geometric mean over scenes; null if a scene has no value or there are no scenes.
template <typename Figure>
std::optional<double> mean_over(std::span<const SceneBench> scenes, Figure&& figure) {
  std::vector<double> values;
  for (const SceneBench& bench : scenes) {
    if (const std::optional<double> value = figure(bench)) values.push_back(*value);
  }
  if (values.size() != scenes.size() || values.empty()) return std::nullopt;
  return geometric_mean(values);
}

std::optional<double> efficiency_value(const SceneBench& bench) {
  const auto interval = efficiency(bench);
  return interval ? std::optional(interval->value) : std::nullopt;
}

/// Converts an interval; infinity becomes null, since JSON has none.
ordered_json to_json(const Interval& interval) {
  return {{"value", interval.value},
          {"low", interval.low},
          {"high", std::isfinite(interval.high) ? ordered_json(interval.high) : ordered_json()}};
}

ordered_json or_null(const std::optional<double>& value) {
  return value ? ordered_json(*value) : ordered_json(nullptr);
}

ordered_json or_null(const std::optional<Interval>& interval) {
  return interval ? to_json(*interval) : ordered_json(nullptr);
}

std::string text_of(const std::optional<double>& value) {
  return value ? absl::StrFormat("%.4g", *value) : "-";
}

std::string text_of(const Interval& interval) {
  return absl::StrFormat("%.4g (%.4g to %.4g)", interval.value, interval.low, interval.high);
}

std::string target_name(double target) {
  return absl::StrFormat("to %g", target);
}

}  // namespace

Interval median_and_band(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  const double median =
      values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  return {values.front(), median, values.back()};
}

std::optional<Interval> relmse_at(const SceneBench& bench, std::size_t k) {
  const Interval error = median_and_band(column(bench, k, &BenchPoint::relmse));
  return error.low >= least_relmse(bench) ? std::optional(error) : std::nullopt;
}

std::optional<double> seconds_to(const SceneBench& bench, double relmse) {
  if (relmse < least_relmse(bench)) return std::nullopt;
  std::vector<double> seconds;
  for (const std::vector<BenchPoint>& curve : bench.points) {
    const auto at = crossing(curve, relmse);
    if (!at) return std::nullopt;
    seconds.push_back(*at);
  }
  if (seconds.empty()) return std::nullopt;
  return median_and_band(std::move(seconds)).value;
}

std::optional<Interval> efficiency(const SceneBench& bench) {
  const auto k = last_usable(bench);
  if (!k) return std::nullopt;
  std::vector<double> logs;
  for (const std::vector<BenchPoint>& seed : bench.points) {
    logs.push_back(-std::log(seed[*k].relmse * seed[*k].cpu_seconds));
  }
  const auto n = static_cast<double>(logs.size());
  double mean = 0, squares = 0;
  for (const double x : logs) mean += x / n;
  for (const double x : logs) squares += (x - mean) * (x - mean);
  double half = std::numeric_limits<double>::infinity();
  if (logs.size() > 1) {
    const std::size_t freedom = logs.size() - 1;
    const double t = freedom <= std::size(kStudent) ? kStudent[freedom - 1] : 1.96;
    half = t * std::sqrt(squares / (n - 1) / n);
  }
  return Interval{std::exp(mean - half), std::exp(mean), std::exp(mean + half)};
}

double geometric_mean(std::span<const double> values) {
  double sum = 0;
  for (const double x : values) sum += std::log(x);
  return std::exp(sum / static_cast<double>(values.size()));
}

ordered_json bench_document(std::span<const SceneBench> scenes) {
  ordered_json document = {{"schema", "tessera.bench/1"}, {"scenes", ordered_json::array()}};
  for (const SceneBench& bench : scenes) {
    ordered_json entry = {{"scene", bench.scene},
                          {"seeds", bench.points.size()},
                          {"seeds_used", bench.seeds},
                          {"reference_relmse", bench.reference_relmse},
                          {"least_relmse", least_relmse(bench)},
                          {"rounds", ordered_json::array()}};
    for (std::size_t k = 0; k < bench.spp.size(); ++k) {
      entry["rounds"].push_back(
          {{"spp", bench.spp[k]},
           {"cpu_seconds", to_json(median_and_band(column(bench, k, &BenchPoint::cpu_seconds)))},
           {"relmse", or_null(relmse_at(bench, k))}});
    }
    for (const double target : kTargets) {
      entry["cpu_seconds_to"][absl::StrFormat("%g", target)] = or_null(seconds_to(bench, target));
    }
    entry["efficiency"] = or_null(efficiency(bench));
    entry["seconds"] = {
        {"load", bench.load},         {"build", bench.build}, {"first_pixel", bench.first_pixel},
        {"render_cpu", bench.render}, {"wall", bench.wall},   {"rest", bench.rest}};
    document["scenes"].push_back(entry);
  }
  ordered_json means = {{"efficiency", or_null(mean_over(scenes, efficiency_value))}};
  for (const double target : kTargets) {
    means["cpu_seconds_to"][absl::StrFormat("%g", target)] = or_null(
        mean_over(scenes, [&](const SceneBench& bench) { return seconds_to(bench, target); }));
  }
  document["geometric_means"] = means;
  return document;
}

std::string bench_text(std::span<const SceneBench> scenes) {
  Table rounds({"scene", "spp", "CPU s", "relMSE: median (minimum to maximum)"});
  Table summary({"scene", "reference", target_name(kTargets[0]), target_name(kTargets[1]),
                 target_name(kTargets[2]), "efficiency", "load s", "build s", "first pixel s",
                 "render CPU s", "rest s"});
  for (const SceneBench& bench : scenes) {
    for (std::size_t k = 0; k < bench.spp.size(); ++k) {
      const auto error = relmse_at(bench, k);
      rounds.add({bench.scene, absl::StrCat(bench.spp[k]),
                  absl::StrFormat(
                      "%.4g", median_and_band(column(bench, k, &BenchPoint::cpu_seconds)).value),
                  error ? text_of(*error) : "below ten times the reference's own relMSE"});
    }
    const auto interval = efficiency(bench);
    summary.add({bench.scene, absl::StrFormat("%.2g", bench.reference_relmse),
                 text_of(seconds_to(bench, kTargets[0])), text_of(seconds_to(bench, kTargets[1])),
                 text_of(seconds_to(bench, kTargets[2])), interval ? text_of(*interval) : "-",
                 absl::StrFormat("%.3f", bench.load), absl::StrFormat("%.3f", bench.build),
                 absl::StrFormat("%.3f", bench.first_pixel), absl::StrFormat("%.3f", bench.render),
                 absl::StrFormat("%.3f", bench.rest)});
  }
  const auto mean_to = [&](double target) {
    return text_of(
        mean_over(scenes, [&](const SceneBench& bench) { return seconds_to(bench, target); }));
  };
  summary.add({"geometric mean", "", mean_to(kTargets[0]), mean_to(kTargets[1]),
               mean_to(kTargets[2]), text_of(mean_over(scenes, efficiency_value)), "", "", "", "",
               ""});
  return absl::StrCat(rounds.text(),
                      "\nCPU seconds to a relMSE; efficiency is 1 / (relMSE x CPU seconds)\n",
                      summary.text());
}

}  // namespace tessera::client
