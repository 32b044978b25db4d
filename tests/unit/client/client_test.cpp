// Option parsing, file names and output: everything that needs no server.
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/charts/accelerators_svg.h"
#include "client/charts/curve_svg.h"
#include "client/charts/tile_svg.h"
#include "client/cli/progress.h"
#include "client/cli/table.h"
#include "client/output/frame_files.h"
#include "client/output/job_status.h"
#include "client/output/render_result.h"
#include "client/request/job_request.h"
#include "client/request/render_options.h"
#include "contract/structure_names.h"

namespace tessera::client {
namespace {

using contract::FrameRange;

TEST(ParseFrames, AcceptsSinglesRangesAndSteps) {
  EXPECT_EQ(*parse_frames("0"), (std::vector<FrameRange>{{0, 0, 1}}));
  EXPECT_EQ(*parse_frames("1-10x3"), (std::vector<FrameRange>{{1, 10, 3}}));
  EXPECT_EQ(*parse_frames("1,4,9-12"), (std::vector<FrameRange>{{1, 1, 1}, {4, 4, 1}, {9, 12, 1}}));
  for (const char* wrong : {"", "a", "-1", "3-1", "1-", "1-2x0", "1,,2", "1-2x", "1 ", "1-2-3"}) {
    EXPECT_FALSE(parse_frames(wrong).ok()) << wrong;
  }
}

TEST(ParseSizeAndCrop, AcceptIntegersOnly) {
  std::int32_t width = 0, height = 0;
  EXPECT_TRUE(parse_size("640x360", width, height).ok());
  EXPECT_EQ(width, 640);
  EXPECT_EQ(height, 360);
  for (const char* wrong : {"", "640", "640x", "x360", "0x5", "640x360x2", "1e3x5", "99999x1"}) {
    EXPECT_FALSE(parse_size(wrong, width, height).ok()) << wrong;
  }
  EXPECT_EQ(*parse_crop("1,2,3,4"), (contract::PixelRect{1, 2, 3, 4}));
  for (const char* wrong : {"", "1,2,3", "1,2,3,4,5", "1;2;3;4"}) {
    EXPECT_FALSE(parse_crop(wrong).ok()) << wrong;
  }
}

TEST(ParseBackground, AcceptsNoneOrColour) {
  contract::RenderSettings settings;
  EXPECT_TRUE(parse_background("none", settings).ok());
  EXPECT_EQ(settings.background, contract::Background::none);
  EXPECT_TRUE(parse_background("0.5,1e1,0", settings).ok());
  EXPECT_EQ(settings.background, contract::Background::color);
  EXPECT_EQ(settings.background_color, (std::array<float, 3>{0.5f, 10, 0}));
  for (const char* wrong : {"", "1,2", "1,2,3,4", "nan,0,0", "-1,0,0", "inf,0,0", "red"}) {
    EXPECT_FALSE(parse_background(wrong, settings).ok()) << wrong;
  }
}

RenderOptions parsed(const std::vector<std::string>& words) {
  CLI::App app;
  RenderOptions options;
  add_render_options(app, options);
  std::vector<std::string> reversed(words.rbegin(), words.rend());
  app.parse(reversed);
  return options;
}

TEST(RenderOptions, DefaultsMatchContract) {
  EXPECT_EQ(settings_of(parsed({"scene.glb"}), "")->width, 1280);
  const auto settings = settings_of(parsed({"scene.glb"}), "");
  ASSERT_TRUE(settings.ok()) << settings.status();
  const contract::RenderSettings defaults;
  EXPECT_EQ(settings->height, defaults.height);
  EXPECT_EQ(settings->spp, defaults.spp);
  EXPECT_EQ(settings->max_depth, defaults.max_depth);
  EXPECT_EQ(settings->tile, defaults.tile);
  EXPECT_EQ(settings->fps, defaults.fps);
  EXPECT_EQ(settings->frames, defaults.frames);
  EXPECT_EQ(settings->filter_width, 1);
  EXPECT_EQ(settings->scene, -1);
  EXPECT_EQ(settings->background, contract::Background::automatic);
}

TEST(RenderOptions, EachOptionSetsItsField) {
  const auto settings = settings_of(parsed({"scene.glb",
                                            "--size",
                                            "64x32",
                                            "--crop",
                                            "1,2,30,20",
                                            "--camera",
                                            "Top",
                                            "--scene",
                                            "2",
                                            "--frames",
                                            "3-9x2",
                                            "--fps",
                                            "30",
                                            "--animation",
                                            "all",
                                            "--variant",
                                            "red",
                                            "--spp",
                                            "100",
                                            "--max-depth",
                                            "3",
                                            "--seed",
                                            "4294967295",
                                            "--tile-size",
                                            "16",
                                            "--filter",
                                            "gaussian",
                                            "--environment-rotation",
                                            "-90",
                                            "--environment-strength",
                                            "2",
                                            "--background",
                                            "1,0,0",
                                            "--aov",
                                            "depth,albedo",
                                            "--half",
                                            "--clamp",
                                            "10",
                                            "--cull-backfaces",
                                            "--guiding"}),
                                    "environment/sky.exr");
  ASSERT_TRUE(settings.ok()) << settings.status();
  EXPECT_EQ(settings->crop, (contract::PixelRect{1, 2, 30, 20}));
  EXPECT_EQ(settings->camera, "Top");
  EXPECT_EQ(settings->scene, 2);
  EXPECT_EQ(settings->frames, (std::vector<FrameRange>{{3, 9, 2}}));
  EXPECT_EQ(settings->fps, 30);
  EXPECT_EQ(settings->animation, "all");
  EXPECT_EQ(settings->variant, "red");
  EXPECT_EQ(settings->spp, 100);
  EXPECT_EQ(settings->max_depth, 3);
  EXPECT_EQ(settings->seed, 4294967295u);
  EXPECT_EQ(settings->tile, 16);
  EXPECT_EQ(settings->filter, contract::PixelFilter::gaussian);
  EXPECT_EQ(settings->filter_width, 3) << "the filter's own width";
  EXPECT_EQ(settings->environment, "environment/sky.exr");
  EXPECT_EQ(settings->environment_rotation, -90);
  EXPECT_EQ(settings->environment_strength, 2);
  EXPECT_EQ(settings->background_color, (std::array<float, 3>{1, 0, 0}));
  EXPECT_EQ(settings->aovs, contract::kAovDepth | contract::kAovAlbedo);
  EXPECT_TRUE(settings->half);
  EXPECT_EQ(settings->clamp, 10);
  EXPECT_TRUE(settings->cull_backfaces);
  EXPECT_EQ(settings->guiding, true);
}

TEST(RenderOptions, GuidingIsUnsetUntilChosen) {
  EXPECT_EQ(settings_of(parsed({"scene.glb"}), "")->guiding, std::nullopt);
  EXPECT_EQ(settings_of(parsed({"scene.glb", "--no-guiding"}), "")->guiding, false);
}

TEST(RenderOptions, ErrorNamesWrongOption) {
  const std::vector<std::vector<std::string>> wrong = {{"--size", "0x0"},
                                                       {"--tile-size", "48"},
                                                       {"--spp", "0"},
                                                       {"--max-depth", "256"},
                                                       {"--seed", "-1"},
                                                       {"--filter", "triangle"},
                                                       {"--frames", "5-1"},
                                                       {"--crop", "1,2"},
                                                       {"--fps", "0"},
                                                       {"--clamp", "-1"},
                                                       {"--background", ""},
                                                       {"--no-such", "1"},
                                                       {"--environment", "no-such-file.exr"}};
  for (std::vector<std::string> words : wrong) {
    const std::string name = words.front();
    words.insert(words.begin(), "scene.glb");
    try {
      parsed(words);
      ADD_FAILURE() << name << " was accepted";
    } catch (const CLI::ParseError& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  }
  EXPECT_FALSE(settings_of(parsed({"scene.glb", "--aov", "beauty"}), "").ok());
  EXPECT_FALSE(settings_of(parsed({"scene.glb", "--crop", "0,0,5000,10"}), "").ok());
}

TEST(FileNames, AreSanitisedAndNumbered) {
  EXPECT_EQ(clean_name("a b/ö.glb"), "a_b___.glb");
  EXPECT_EQ(clean_name(".hidden"), "_hidden");
  EXPECT_EQ(clean_name(""), "_");
  EXPECT_EQ(stem_of("dir.d/scene.v2.glb"), "scene.v2");
  EXPECT_EQ(stem_of("scene"), "scene");
  EXPECT_EQ(with_frame_number("out/a.exr", 7), "out/a.0007.exr");
  EXPECT_EQ(with_frame_number("a.exr", 123456), "a.123456.exr");
  EXPECT_EQ(with_frame_number("dir.d/a", 1), "dir.d/a.0001");
  EXPECT_EQ(*format_of("a.EXR"), v1::FetchFrameRequest::FORMAT_EXR);
  EXPECT_EQ(*format_of("a.jpeg"), v1::FetchFrameRequest::FORMAT_JPEG);
  EXPECT_FALSE(format_of("a.tiff").ok());
}

v1::Job running_job() {
  v1::Job job;
  job.set_state(v1::Job::STATE_RUNNING);
  v1::JobProgress& progress = *job.mutable_progress();
  progress.set_sample_count(1000);
  progress.set_committed_sample_count(250);
  progress.set_frame_count(1);
  progress.set_worker_count(2);
  progress.set_estimated_error(0.0125);
  progress.mutable_remaining()->set_seconds(125);
  return job;
}

TEST(ProgressLine, FitsTerminalWidth) {
  const std::string line = progress_line(running_job(), 120);
  for (const char* part : {"25 %", "250 samples", "error 0.0125", "2 workers", "2:05 left"}) {
    EXPECT_NE(line.find(part), std::string::npos) << part << " is not in: " << line;
  }
  for (const int columns : {10, 40, 80, 120}) {
    EXPECT_LT(progress_line(running_job(), columns).size(), static_cast<std::size_t>(columns));
  }
}

TEST(Figures, AreRoundedForReaders) {
  EXPECT_EQ(format_seconds(4.24), "4.2 s");
  EXPECT_EQ(format_seconds(42), "42 s");
  EXPECT_EQ(format_seconds(125), "2:05");
  EXPECT_EQ(format_seconds(7384), "2:03:04");
  EXPECT_EQ(format_count(950), "950");
  EXPECT_EQ(format_count(59e6), "59.0 M");
}

TEST(Figures, LongTextIsCutBetweenCharacters) {
  EXPECT_EQ(beginning_of_line("", 3), "");
  EXPECT_EQ(beginning_of_line("äöü", 3), "äöü");
  EXPECT_EQ(beginning_of_line("äöüß", 3), "äöü…");
  EXPECT_EQ(beginning_of_line("a\nb", 3), "a…");
}

TEST(Figures, BoxesShowNoRoundingErrors) {
  EXPECT_EQ(format_box({-1.4e-08, -1, 0}, {1, 2.5, -3e-9}), "(0, -1, 0) to (1, 2.5, 0)");
  EXPECT_EQ(format_box({-1.4e-08, 0, 0}, {1.5e-08, 0, 0}), "(-1.4e-08, 0, 0) to (1.5e-08, 0, 0)");
  EXPECT_EQ(format_box({0, 0, 0}, {0, 0, 0}), "(0, 0, 0) to (0, 0, 0)");
}

TEST(ExitCode, FollowsStateAndFailureCode) {
  v1::Job job;
  job.set_state(v1::Job::STATE_DONE);
  EXPECT_EQ(exit_code_of(job), 0);
  job.set_certainty(v1::Job::CERTAINTY_CAPPED);
  EXPECT_EQ(exit_code_of(job), 4);
  job.set_state(v1::Job::STATE_CANCELLED);
  EXPECT_EQ(exit_code_of(job), 1);
  job.set_state(v1::Job::STATE_FAILED);
  job.set_failure_code(static_cast<int>(absl::StatusCode::kInternal));
  job.set_reason("bad scene: the text does not matter");
  EXPECT_EQ(exit_code_of(job), 1);
  job.set_failure_code(static_cast<int>(absl::StatusCode::kInvalidArgument));
  job.set_reason("scene.glb: cameras: no camera \"Top\"");
  EXPECT_EQ(exit_code_of(job), 2);
}

TEST(ExitCode, OfEveryStatusCode) {
  struct Case {
    absl::StatusCode code;
    int call, job;
  };
  const Case cases[] = {
      {absl::StatusCode::kOk, 0, 1},
      {absl::StatusCode::kCancelled, 130, 1},
      {absl::StatusCode::kUnknown, 3, 1},
      {absl::StatusCode::kInvalidArgument, 2, 2},
      {absl::StatusCode::kDeadlineExceeded, 3, 1},
      {absl::StatusCode::kNotFound, 2, 2},
      {absl::StatusCode::kAlreadyExists, 2, 1},
      {absl::StatusCode::kPermissionDenied, 3, 1},
      {absl::StatusCode::kResourceExhausted, 3, 1},
      {absl::StatusCode::kFailedPrecondition, 2, 1},
      {absl::StatusCode::kAborted, 3, 1},
      {absl::StatusCode::kOutOfRange, 2, 1},
      {absl::StatusCode::kUnimplemented, 2, 2},
      {absl::StatusCode::kInternal, 3, 1},
      {absl::StatusCode::kUnavailable, 3, 1},
      {absl::StatusCode::kDataLoss, 3, 1},
      {absl::StatusCode::kUnauthenticated, 3, 1},
  };
  for (const Case& each : cases) {
    EXPECT_EQ(exit_code(each.code), each.call) << each.code;
    EXPECT_EQ(failed_job_exit_code(each.code), each.job) << each.code;
  }
}

TEST(ResultLine, PrintsSizeSamplesErrorAndSeconds) {
  auto report = nlohmann::ordered_json::parse(
      R"({"frames": [{"frame": 0, "file": "x", "width": 640, "height": 360, "samples": 14745600,
          "estimated": {"error": 0.01234}}]})");
  name_files(report, {"out.exr"});
  EXPECT_EQ(result_line(report, 3.21),
            "out.exr: 640x360, 14.7 M samples, estimated error 0.01234, 3.2 s");
}

TEST(RequestId, DependsOnlyOnJob) {
  v1::CreateJobRequest request;
  request.set_name("one");
  const std::string id = derived_request_id(request);
  request.set_request_id(id);
  EXPECT_EQ(derived_request_id(request), id) << "the id itself does not count";
  EXPECT_LE(id.size(), 64u);
  request.mutable_settings()->set_seed(1);
  EXPECT_NE(derived_request_id(request), id);
  EXPECT_NE(random_request_id(), random_request_id());
}

TEST(RenderOptions, AcceptErrorOrSampleCount) {
  const auto by_error = settings_of(parsed({"scene.glb", "--error", "0.05"}), "");
  ASSERT_TRUE(by_error.ok()) << by_error.status();
  EXPECT_EQ(by_error->error, 0.05);
  EXPECT_EQ(by_error->spp, 16384) << "--max-spp";
  EXPECT_EQ(settings_of(parsed({"scene.glb", "--error", "0.05", "--max-spp", "64"}), "")->spp, 64);
  EXPECT_FALSE(settings_of(parsed({"scene.glb", "--spp", "64"}), "")->error);
}

TEST(CurveSvg, DrawsEstimateAndTrueErrorOnLogAxes) {
  const auto report = nlohmann::ordered_json::parse(R"({"job": "abc", "status": "CONVERGED",
    "frames": [{"curve": [
      {"cpu_seconds": 1, "error": 0.4, "error_true": null},
      {"cpu_seconds": 4, "error": 0.2, "error_true": null},
      {"cpu_seconds": 16, "error": 0.1, "error_true": 0.11}]}]})");
  const std::string svg = curve_svg(report);
  EXPECT_EQ(svg.find("<svg"), 0u);
  EXPECT_NE(svg.find("prefers-color-scheme:dark"), std::string::npos);
  EXPECT_NE(svg.find("true error"), std::string::npos);
  // On logarithmic axes equal factors are equal distances, and the points follow the guides: 4
  // times the work.
  std::vector<double> xs, ys;
  std::size_t at = 0;
  const std::string mark = "circle class=\"estimate\" cx=\"";
  while ((at = svg.find(mark, at)) != std::string::npos) {
    at += mark.size();
    xs.push_back(std::stod(svg.substr(at)));
    ys.push_back(std::stod(svg.substr(svg.find("cy=\"", at) + 4)));
  }
  ASSERT_EQ(xs.size(), 3u);
  EXPECT_NEAR(xs[2] - xs[1], xs[1] - xs[0], 0.2);
  EXPECT_NEAR(ys[2] - ys[1], ys[1] - ys[0], 0.2);
  EXPECT_GT(ys[1], ys[0]) << "less error is lower on the page";
  EXPECT_EQ(curve_svg(nlohmann::ordered_json::parse(R"({"frames": []})")), "");
}

/// The box of a label in an SVG; letters are taken as 6 wide and 9 high.
struct LabelBox {
  double x, y, width;
  bool overlaps(const LabelBox& other) const {
    return x < other.x + other.width && other.x < x + width && std::abs(y - other.y) < 9;
  }
};

/// Finds `>name</text>`.
LabelBox label_of(const std::string& svg, const std::string& name, std::size_t from) {
  const std::size_t words = svg.find(">" + name + "</text>", from);
  EXPECT_NE(words, std::string::npos) << name;
  if (words == std::string::npos) return {};
  const std::size_t element = svg.rfind("<text x=\"", words);
  const std::size_t y = svg.find("y=\"", element);
  return {std::stod(svg.substr(element + 9)), std::stod(svg.substr(y + 3)),
          6.0 * static_cast<double>(name.size())};
}

TEST(AcceleratorsSvg, LabelsOfEqualStructuresDoNotOverlap) {
  nlohmann::ordered_json table = {{"rays", {{"camera", 3}, {"bounce", 0}, {"shadow", 1}}},
                                  {"structures", nlohmann::ordered_json::array()}};
  std::vector<std::string> names;
  for (const char* structure : contract::kStructureNames) {
    names.emplace_back(structure);
    const nlohmann::ordered_json query = {
        {"mrays_per_second", 2}, {"nodes_per_ray", 8}, {"triangles_per_ray", 4}};
    table["structures"].push_back({{"name", structure},
                                   {"build_seconds", 0.5},
                                   {"memory_bytes", 1 << 20},
                                   {"closest_hit", query},
                                   {"any_hit", query}});
  }
  const auto svg = accelerators_svg(table);
  ASSERT_TRUE(svg.ok()) << svg.status();
  for (const std::size_t panel : {std::size_t{0}, svg->find(">Visits<")}) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      const LabelBox box = label_of(*svg, names[i], panel);
      EXPECT_GT(box.x, panel == 0 ? 84 : 624);
      EXPECT_LT(box.x + box.width, panel == 0 ? 530 : 1070);
      for (std::size_t k = 0; k < i; ++k) {
        EXPECT_FALSE(box.overlaps(label_of(*svg, names[k], panel))) << names[i] << names[k];
      }
    }
  }
}

TEST(AcceleratorsSvg, CostIsMeanOverAllRays) {
  const auto table = nlohmann::ordered_json::parse(R"({
    "rays": {"camera": 1, "bounce": 2, "shadow": 1}, "structures": [
    {"name": "wide-bvh-avx2", "build_seconds": 0.1, "memory_bytes": 1048576,
     "closest_hit": {"mrays_per_second": 0.1, "nodes_per_ray": null, "triangles_per_ray": null},
     "any_hit": {"mrays_per_second": 0.1, "nodes_per_ray": null, "triangles_per_ray": null}},
    {"name": "grid", "build_seconds": 1, "memory_bytes": 1048576,
     "closest_hit": {"mrays_per_second": 1, "nodes_per_ray": 1, "triangles_per_ray": 1},
     "any_hit": {"mrays_per_second": 0.1, "nodes_per_ray": 1, "triangles_per_ray": 1}},
    {"name": "octree", "build_seconds": 10, "memory_bytes": 1048576,
     "closest_hit": {"mrays_per_second": 0.3076923, "nodes_per_ray": 2, "triangles_per_ray": 1},
     "any_hit": {"mrays_per_second": 0.3076923, "nodes_per_ray": 2, "triangles_per_ray": 1}}]})");
  const auto svg = accelerators_svg(table);
  ASSERT_TRUE(svg.ok()) << svg.status();
  std::vector<double> heights;
  for (std::size_t at = svg->find("cy=\""); at < svg->find(">Visits<");
       at = svg->find("cy=\"", at + 4)) {
    heights.push_back(std::stod(svg->substr(at + 4)));
  }
  ASSERT_EQ(heights.size(), 3u);
  EXPECT_LT(heights[0], heights[1]);
  EXPECT_EQ(heights[1], heights[2]) << "(3 * 1 + 1 * 10) / 4 = 3.25 µs";
  EXPECT_EQ(svg->find("wide-bvh-avx2", svg->find(">Visits<")), std::string::npos) << "not counted";
  const auto& none = nlohmann::ordered_json::object();
  EXPECT_EQ(accelerators_svg(none).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(TileSvg, PlacesAndColoursTiles) {
  // Three tiles in a row of a crop, the last narrower.
  auto report = nlohmann::ordered_json::parse(R"({
    "settings": {"width": 200, "height": 100, "crop": [30, 10, 40, 16], "tile": 16},
    "frames": [{"frame": 7, "tiles": {"error": [0.01, 1, 0.1], "spp": [8, 8, 8]}}]})");
  const auto svg = tile_svg(report);
  ASSERT_TRUE(svg.ok()) << svg.status();
  EXPECT_NE(svg->find("frame 7, error: 0.01 to 1"), std::string::npos);
  // 400 units wide for 40 pixels: a pixel is 10 units. Colours of the minimum, the maximum and
  // their geometric mean.
  const std::string left = "<rect x=\"16.00\" y=\"28.00\" width=\"160.00\" height=\"160.00\" fill=";
  const std::string middle =
      "<rect x=\"176.00\" y=\"28.00\" width=\"160.00\" height=\"160.00\" fill=";
  const std::string narrow =
      "<rect x=\"336.00\" y=\"28.00\" width=\"80.00\" height=\"160.00\" fill=";
  EXPECT_NE(svg->find(left + "\"#440154\"><title>tile 0: 0.01"), std::string::npos) << *svg;
  EXPECT_NE(svg->find(middle + "\"#fde725\"><title>tile 1: 1"), std::string::npos) << *svg;
  EXPECT_NE(svg->find(narrow + "\"#21918c\"><title>tile 2: 0.1"), std::string::npos) << *svg;
  EXPECT_NE(svg->find("samples per pixel: 8 to 8"), std::string::npos);
  EXPECT_NE(svg->find("<title>tile 2: 8<"), std::string::npos) << "beside it, the samples";
  report["frames"][0]["tiles"] = nullptr;
  EXPECT_EQ(tile_svg(report).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(TileSvg, HatchesZeroTiles) {
  auto report = nlohmann::ordered_json::parse(R"({
    "settings": {"width": 48, "height": 16, "tile": 16},
    "frames": [{"frame": 7, "tiles": {"error": [0, 0.5, 0.25], "spp": [8, 8, 8]}}]})");
  const std::string svg = *tile_svg(report);
  EXPECT_NE(svg.find("frame 7, error: 0.25 to 0.5, 0 hatched<"), std::string::npos) << svg;
  EXPECT_NE(svg.find("fill=\"url(#zero)\"><title>tile 0: 0<"), std::string::npos) << svg;
  EXPECT_NE(svg.find("fill=\"#440154\"><title>tile 2: 0.25<"), std::string::npos) << svg;
  EXPECT_NE(svg.find("samples per pixel: 8 to 8<"), std::string::npos) << "no tile is 0";
  report["frames"][0]["tiles"]["error"] = {0, 0, 0};
  EXPECT_NE(tile_svg(report)->find("frame 7, error: 0 hatched<"), std::string::npos);
}

TEST(TileSvg, FitsTallCropsIntoSquare) {
  const auto report = nlohmann::ordered_json::parse(R"({
    "settings": {"width": 64, "height": 640, "crop": [0, 0, 8, 640], "tile": 320},
    "frames": [{"frame": 7, "tiles": {"error": [0.5, 0.5], "spp": [8, 8]}}]})");
  const std::string svg = *tile_svg(report);
  EXPECT_NE(svg.find("viewBox=\"0 0 848 444\""), std::string::npos) << svg;
  EXPECT_NE(svg.find("width=\"5.00\" height=\"200.00\""), std::string::npos) << svg;
}

TEST(ResultLine, ErrorTargetPrintsBoundAndCertainty) {
  const auto report = nlohmann::ordered_json::parse(R"({"status": "CAPPED", "frames": [
    {"file": "out.exr", "width": 64, "height": 48, "samples": 3072,
     "estimated": {"error": 0.1, "error_upper95": 0.125}}]})");
  EXPECT_EQ(
      result_line(report, 1.5),
      "out.exr: 64x48, 3.1 k samples, estimated error 0.1, ≤ 0.125 at 95 % confidence, CAPPED, "
      "1.5 s");
}

TEST(ResultLine, DenoisedFramePrintsItsOwnBound) {
  const auto report = nlohmann::ordered_json::parse(R"({"status": "CONVERGED", "frames": [
    {"file": "out.exr", "width": 64, "height": 48, "samples": 3072,
     "estimated": {"error": 0.1, "error_upper95": 0.125},
     "denoised": {"error_denoised": 0.03, "error_denoised_upper95": 0.05}}]})");
  EXPECT_EQ(
      result_line(report, 1.5),
      "out.exr: 64x48, 3.1 k samples, estimated error 0.03, ≤ 0.05 at 95 % confidence, CONVERGED, "
      "1.5 s");
}

TEST(ResultLine, UncertainErrorIsNotClaimed) {
  const auto report = nlohmann::ordered_json::parse(R"({"status": "UNCERTAIN",
    "reasons": ["frame 0: --clamp removed radiance"], "warnings": ["--max-depth cut light"],
    "frames": [{"file": "out.exr", "width": 64, "height": 48, "samples": 3072,
     "estimated": {"error": 0.1, "error_upper95": 0.125}}]})");
  EXPECT_EQ(result_line(report, 1.5),
            "out.exr: 64x48, 3.1 k samples, estimated error 0.1, UNCERTAIN, 1.5 s");
  EXPECT_EQ(warning_lines(report),
            "tessera: frame 0: --clamp removed radiance\ntessera: --max-depth cut light\n");
  const std::string already_printed[] = {"--max-depth cut light"};
  EXPECT_EQ(warning_lines(report, already_printed), "tessera: frame 0: --clamp removed radiance\n");
}

}  // namespace
}  // namespace tessera::client
