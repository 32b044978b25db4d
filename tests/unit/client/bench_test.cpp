#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "client/bench/bench_reference.h"
#include "client/bench/bench_stats.h"
#include "rpc/settings_message.h"

namespace tessera::client {
namespace {

/// Two seeds whose relMSE is 0.1 / spp and 0.4 / spp, at 0.5 CPU seconds a sample.
SceneBench falling() {
  SceneBench bench;
  bench.scene = "falling";
  bench.seeds = {1, 2};
  bench.spp = {1, 10, 100};
  for (const double factor : {0.1, 0.4}) {
    auto& curve = bench.points.emplace_back();
    for (const int spp : bench.spp) curve.push_back({0.5 * spp, factor / spp});
  }
  return bench;
}

TEST(Bench, MedianAndBandUseSortedValues) {
  const Interval odd = median_and_band({3, 1, 2});
  EXPECT_EQ(odd.low, 1);
  EXPECT_EQ(odd.value, 2);
  EXPECT_EQ(odd.high, 3);
  EXPECT_EQ(median_and_band({4, 1, 2, 3}).value, 2.5);
}

TEST(Bench, SecondsToErrorAreReadPerSeed) {
  // 0.1 / spp = 0.01 at 10 samples, 5 s; 0.4 / spp at 40, 20 s.
  EXPECT_NEAR(seconds_to(falling(), 0.01).value(), (5.0 + 20.0) / 2, 1e-9);
  EXPECT_FALSE(seconds_to(falling(), 1e-4)) << "the second curve ends at 0.004";
}

TEST(Bench, ResultsStopAtTenTimesReferenceError) {
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

TEST(Bench, JsonOmitsWhatTextOmits) {
  SceneBench bench = falling();
  bench.reference_relmse = 0.0009;
  const auto scene = bench_document({&bench, 1})["scenes"][0];
  EXPECT_EQ(scene["rounds"][1]["relmse"]["low"], 0.01);
  EXPECT_TRUE(scene["rounds"][2]["relmse"].is_null()) << "0.001 is below ten times 0.0009";
  EXPECT_EQ(scene["rounds"][2]["cpu_seconds"]["value"], 50);
}

TEST(Bench, EfficiencyIntervalUsesStudentsT) {
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

TEST(Bench, SceneMeansNeedEveryScene) {
  std::vector<SceneBench> scenes = {falling(), falling()};
  for (auto& curve : scenes[1].points) {
    for (BenchPoint& point : curve) point.cpu_seconds *= 4;
  }
  const auto means = bench_document(scenes)["geometric_means"];
  EXPECT_NEAR(means["cpu_seconds_to"]["0.01"].get<double>(), 12.5 * 2, 1e-9);
  EXPECT_TRUE(means["cpu_seconds_to"]["0.0001"].is_null());
  EXPECT_NEAR(means["efficiency"].get<double>(), 5, 1e-9);
}

TEST(Bench, SeedsExcludeReferenceSeed) {
  EXPECT_EQ(bench_seeds(3, 1'000'003), (std::vector<std::int64_t>{1, 2, 3}));
  EXPECT_EQ(bench_seeds(3, 2), (std::vector<std::int64_t>{1, 3, 4}));
  SceneBench bench = falling();
  bench.seeds = bench_seeds(2, 1);
  EXPECT_EQ(bench_document({&bench, 1})["scenes"][0]["seeds_used"], nlohmann::ordered_json({2, 3}));
}

/// A report with no setting at its default.
nlohmann::json odd_report() {
  return nlohmann::json::parse(R"({"scene_sha256": "abc", "settings": {
      "width": 40, "height": 30, "crop": [4, 5, 16, 12], "camera": "Top", "scene": 1,
      "frames": [{"first": 12, "last": 12, "step": 1}], "fps": 30.5, "animation": "none",
      "variant": "red", "spp": 1024, "error": 0.01, "max_depth": 7, "seed": 9, "tile": 16,
      "filter": "gaussian", "filter_width": 2.5, "environment": "environment-0123/sky.exr",
      "environment_rotation": 90.25, "environment_strength": 0.123456789012,
      "background": [1, 0.5, 0.20000000298023224], "half": true, "clamp": 3.5,
      "cull_backfaces": true, "aov_bits": 127},
    "frames": [{"frame": 12, "estimated": {"relmse": 0.0002}}]})");
}

TEST(Bench, ReferenceSettingsAreAdopted) {
  const auto reference = read_reference_report(odd_report().dump());
  ASSERT_TRUE(reference.ok()) << reference.status();
  EXPECT_EQ(reference->environment, "sky.exr");
  EXPECT_EQ(reference->scene_sha256, "abc");
  EXPECT_EQ(reference->seed, 9);
  EXPECT_EQ(reference->relmse, 0.0002);
  contract::RenderSettings expected;
  expected.width = 40;
  expected.height = 30;
  expected.crop = contract::PixelRect{4, 5, 16, 12};
  expected.camera = "Top";
  expected.scene = 1;
  expected.frames = {{12, 12, 1}};
  expected.fps = 30.5;
  expected.animation = "none";
  expected.variant = "red";
  expected.max_depth = 7;
  expected.filter = contract::PixelFilter::gaussian;
  expected.filter_width = 2.5;
  expected.environment_rotation = 90.25;
  expected.environment_strength = 0.123456789012;
  expected.background = contract::Background::color;
  expected.background_color = {1, 0.5f, 0.2f};
  expected.clamp = 3.5;
  expected.cull_backfaces = true;
  const auto taken = settings_of(reference->render, "");
  ASSERT_TRUE(taken.ok()) << taken.status();
  EXPECT_EQ(contract::to_message(*taken).DebugString(),
            contract::to_message(expected).DebugString());
}

TEST(Bench, UnsuitableReportIsRefused) {
  const auto fault = [](const nlohmann::json& report) {
    return std::string(read_reference_report(report.dump()).status().message());
  };
  EXPECT_EQ(fault(nlohmann::json::array()), "not the report of a render");
  nlohmann::json report = odd_report();
  report["frames"].push_back(report["frames"][0]);
  EXPECT_EQ(fault(report), "has 2 frames; expected 1");
  report["frames"] = nlohmann::json::array();
  EXPECT_EQ(fault(report), "has 0 frames; expected 1");
  report = odd_report();
  report["frames"][0]["estimated"] = nullptr;
  EXPECT_EQ(fault(report), "has no error estimate");
  report = odd_report();
  report["settings"]["fps"] = "fast";
  EXPECT_NE(fault(report).find("not the report of a render (["), std::string::npos)
      << fault(report);
}

}  // namespace
}  // namespace tessera::client
