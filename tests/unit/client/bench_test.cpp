#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "client/bench_figures.h"

namespace tessera::client {
namespace {

/// Two seeds whose relMSE is 0.1 / spp and 0.4 / spp, at 0.5 CPU seconds a sample.
SceneBench falling() {
  SceneBench bench;
  bench.scene = "falling";
  bench.spp = {1, 10, 100};
  for (const double factor : {0.1, 0.4}) {
    auto& curve = bench.points.emplace_back();
    for (const int spp : bench.spp) curve.push_back({0.5 * spp, factor / spp});
  }
  return bench;
}

TEST(Bench, MedianAndBandAreThoseOfTheSortedValues) {
  const Interval odd = median_and_band({3, 1, 2});
  EXPECT_EQ(odd.low, 1);
  EXPECT_EQ(odd.value, 2);
  EXPECT_EQ(odd.high, 3);
  EXPECT_EQ(median_and_band({4, 1, 2, 3}).value, 2.5);
}

TEST(Bench, SecondsToAnErrorAreReadOffEachSeedsCurve) {
  // 0.1 / spp = 0.01 at 10 samples, 5 s; 0.4 / spp at 40, 20 s.
  EXPECT_NEAR(seconds_to(falling(), 0.01).value(), (5.0 + 20.0) / 2, 1e-9);
  EXPECT_FALSE(seconds_to(falling(), 1e-4)) << "the second curve ends at 0.004";
}

TEST(Bench, NothingIsSaidBelowTenTimesTheReferencesOwnError) {
  SceneBench bench = falling();
  bench.reference_relmse = 0.0011;
  EXPECT_FALSE(seconds_to(bench, 0.01));
  bench.reference_relmse = 0.0009;
  EXPECT_TRUE(seconds_to(bench, 0.01));
  // The last count at which both errors are at least 0.009 is 10.
  bench.points[0][1].cpu_seconds = 8;
  EXPECT_NEAR(efficiency(bench)->value, std::sqrt(1 / (0.01 * 8) * (1 / (0.04 * 5))), 1e-9);
  bench.reference_relmse = 1;
  EXPECT_FALSE(efficiency(bench));
}

TEST(Bench, EfficiencysIntervalIsStudents) {
  // Logarithms of 1 / (relMSE * seconds): ln 20 and ln 5. Their spread over root two is ln 2; one
  // degree of freedom.
  const Interval interval = efficiency(falling()).value();
  EXPECT_NEAR(interval.value, 10, 1e-9);
  EXPECT_NEAR(interval.high, 10 * std::pow(2, 12.706), 1e-6 * interval.high);
  EXPECT_NEAR(interval.low * interval.high, 100, 1e-6);
  SceneBench one = falling();
  one.points.pop_back();
  EXPECT_TRUE(std::isinf(efficiency(one)->high));
  EXPECT_TRUE(bench_document({&one, 1})["scenes"][0]["efficiency"]["high"].is_null());
}

TEST(Bench, MeansOverScenesNeedTheFigureOfEach) {
  std::vector<SceneBench> scenes = {falling(), falling()};
  for (auto& curve : scenes[1].points) {
    for (BenchPoint& point : curve) point.cpu_seconds *= 4;
  }
  const auto means = bench_document(scenes)["geometric_means"];
  EXPECT_NEAR(means["cpu_seconds_to"]["0.01"].get<double>(), 12.5 * 2, 1e-9);
  EXPECT_TRUE(means["cpu_seconds_to"]["0.0001"].is_null());
  EXPECT_NEAR(means["efficiency"].get<double>(), 5, 1e-9);
}

}  // namespace
}  // namespace tessera::client
