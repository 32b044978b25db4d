/// tessera-bench-coverage: tests the claims of jobs with a target error. Renders one scene with
/// many seeds, with the film and the stopping rule of the farm but without the farm, and compares
/// each claim with the true error, measured against a reference of other seeds. With --fixed it
/// compares the estimates of frames with a fixed sample count instead.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "contract/pass_schedule.h"
#include "image/exr/exr_file.h"
#include "server/film/convergence.h"
#include "server/film/film_cache.h"
#include "server/film/frame_writer.h"
#include "server/frames/finished_frame.h"
#include "tests/bench/coverage/reference.h"
#include "tests/bench/coverage/run_options.h"
#include "tests/support/cpu_seconds.h"

namespace tessera::bench {
namespace {

using testing::cpu_seconds;

using nlohmann::ordered_json;
using testing::ImageMean;
using testing::render_fixed;
using testing::SeededRenderer;

constexpr std::uint32_t kFirstFixedSeed = 2'000'000'000;
constexpr int kFixedSeeds = 6;

struct Options : RunOptions {
  std::int32_t fixed_spp = 0;
};

/// Result of one seed.
struct Outcome {
  server::Certainty certainty = server::Certainty::uncertain;
  double estimate = 0, upper = 0, true_error = 0, true_square = 0, samples = 0, luminance = 0;
};

/// The passes of tiles as the film requests them, as on a farm with one worker.
absl::Status render_on_demand(const SeededRenderer& renderer, const contract::TileGrid& grid,
                              const server::JobSpec& spec, server::FilmCache& film,
                              const server::FrameKey& key) {
  const auto passes = contract::schedule(spec.settings);
  const auto at = [](std::int32_t index) { return static_cast<std::size_t>(index); };
  std::vector<std::pair<std::int32_t, std::int32_t>> waiting;  // tile, pass
  std::vector<std::int32_t> counts(at(grid.tile_count()), 0);
  const auto want = [&](std::int32_t tile, std::int32_t count) {
    for (std::int32_t& has = counts[at(tile)]; has < count; ++has) waiting.emplace_back(tile, has);
  };
  const auto first =
      std::min(contract::kUnconditionalPasses, static_cast<std::int32_t>(passes.size()));
  for (std::int32_t count = 1; count <= first; ++count) {
    for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) want(tile, count);
  }
  for (std::size_t i = 0; i < waiting.size(); ++i) {
    const auto [tile, pass] = waiting[i];
    absl::Status status =
        film.add(key, tile, pass, renderer.render(grid.rect(tile), passes[at(pass)], pass));
    const auto take_targets = [&] {
      const auto demands = film.take_pass_targets(key);
      if (!demands.ok()) return demands.status();
      for (const auto& demand : *demands) want(demand.tile, demand.pass_count);
      return absl::OkStatus();
    };
    if (status.ok()) status = take_targets();
    while (status.ok() && film.is_look_due(key)) {
      status = server::take_denoised_look(film, key, spec);
      if (status.ok()) status = take_targets();
    }
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

/// Writes the finished frame as the server does and reads the denoised image back.
absl::Status denoise_frame(server::FilmCache& film, const server::FrameKey& key,
                           const server::JobSpec& spec, double m, Image& image,
                           server::FrameStatistics& statistics) {
  const std::string path =
      std::filesystem::temp_directory_path() / ("coverage-" + std::to_string(getpid()) + ".exr");
  const server::FrameSpec frame{spec.settings,         0,    "", "", m, film.stopping(key).looks,
                                film.max_samples(key), false};
  const auto result = server::write_frame(
      frame, [&](std::int32_t tile) { return film.tile(key, tile); }, path);
  if (!result.ok()) return result.status();
  statistics = result->statistics;
  auto reader = image::ExrReader::open(path);
  if (!reader.ok()) return reader.status();
  std::vector<image::ExrPlane> planes = (*reader)->planes();
  absl::Status status = (*reader)->read_rows(statistics.height, planes);
  std::filesystem::remove(path);
  for (const image::ExrPlane& plane : planes) {
    const std::size_t channel = std::string("RGB").find(plane.name);
    if (plane.name.size() != 1 || channel > 2) continue;
    for (std::size_t i = 0; i < plane.values.size(); ++i) image[3 * i + channel] = plane.values[i];
  }
  return status;
}

/// Renders one seed until the error is known. Sets `image` to the frame.
absl::StatusOr<Outcome> render_by_error(const SeededRenderer& renderer,
                                        const contract::TileGrid& grid, const Options& options,
                                        const Reference& reference, Image& image) {
  const server::FrameKey key{"job", 0};
  server::JobSpec spec;
  spec.settings = options.settings;
  server::FilmCache film(std::int64_t{1} << 30);
  // Pass 0 of every tile comes before any pass 1, so no tile is read back.
  film.open_frame(key, options.settings, [](std::int32_t, std::int32_t) {
    return absl::StatusOr<contract::FilmBlock>(absl::InternalError("the film is kept whole"));
  });
  absl::Status status = render_on_demand(renderer, grid, spec, film, key);
  if (!status.ok()) return status;
  Outcome outcome;
  server::FrameStatistics statistics;
  const std::int32_t width = grid.window().width;
  image.resize(reference.mean.size());
  const auto m = film.mean_luminance(key);
  if (!m.ok()) return m.status();
  statistics.mean_luminance = *m;
  statistics.estimated = film.running_estimate(key);
  outcome.samples = static_cast<double>(film.expected_samples(key).value_or(0)) /
                    (static_cast<double>(width) * grid.window().height);
  for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
    const auto sum = film.tile(key, tile);
    if (!sum.ok()) return sum.status();
    statistics.dropped_samples += sum->losses().dropped_count;
    testing::put_tile(*sum, grid.rect(tile), width, image);
  }
  if (options.settings.denoise) {
    status = denoise_frame(film, key, spec, *m, image, statistics);
    if (!status.ok()) return status;
  }
  outcome.certainty =
      server::assess_convergence(statistics, film.stopping(key), options.settings).certainty;
  outcome.estimate = statistics.denoised ? statistics.denoised->error : statistics.estimated.error;
  outcome.upper = server::ClaimedError(statistics).error_upper95;
  outcome.true_square = true_square(image, reference, *m);
  outcome.luminance = testing::mean_luminance(image);
  return outcome;
}

/// Renders a frame with a fixed sample count, whose claim is the bound of its estimate.
Outcome render_once(const SeededRenderer& renderer, const contract::TileGrid& grid,
                    const Options& options, const Reference& reference, Image& image) {
  testing::FixedFrame frame = render_fixed(renderer, grid, options.fixed_spp, reference.luminance);
  const contract::ErrorEstimate estimate = contract::estimate_error(frame.sums);
  Outcome outcome;
  outcome.certainty = server::Certainty::converged;
  outcome.estimate = estimate.error;
  outcome.upper = estimate.error_upper95;
  outcome.true_square = true_square(frame.image, reference, reference.luminance);
  outcome.samples = options.fixed_spp;
  outcome.luminance = testing::mean_luminance(frame.image);
  image = std::move(frame.image);
  return outcome;
}

/// Returns the fixed number of samples per pixel that just reaches `error`: root mean square over
/// a few seeds at powers of two, interpolated as a power of n.
absl::StatusOr<double> fixed_samples(SeededRenderer& renderer, const contract::TileGrid& grid,
                                     const Reference& reference,
                                     const contract::RenderSettings& settings) {
  const double target = *settings.error * *settings.error;
  double before = 0;
  for (std::int32_t spp = 8; spp <= settings.spp; spp *= 2) {
    double square = 0;
    for (std::uint32_t seed = 0; seed < kFixedSeeds; ++seed) {
      absl::Status status = renderer.use_seed(kFirstFixedSeed + seed);
      if (!status.ok()) return status;
      const Image image = render_fixed(renderer, grid, spp, 0).image;
      square += true_square(image, reference, reference.luminance) / kFixedSeeds;
    }
    if (square <= target) {
      if (before == 0) return spp;  // or fewer
      const double slope = std::log2(before / square);
      return spp * std::exp2(-std::log2(target / square) / slope);
    }
    before = square;
  }
  return absl::OutOfRangeError("a fixed count of --max-spp does not reach the error");
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

struct Moments {
  double mean = 0, deviation = 0;
};

Moments moments(const std::vector<double>& values) {
  Moments result;
  double squares = 0;
  for (const double value : values) result.mean += value / static_cast<double>(values.size());
  for (const double value : values) {
    squares += (value - result.mean) * (value - result.mean);
  }
  result.deviation = std::sqrt(squares / static_cast<double>(values.size() - 1));
  return result;
}

/// Number of seeds by result.
ordered_json counts(const std::vector<Outcome>& outcomes, double error) {
  int claims = 0, covered = 0, within = 0, uncertain = 0, capped = 0;
  for (const Outcome& outcome : outcomes) {
    uncertain += outcome.certainty == server::Certainty::uncertain;
    capped += outcome.certainty == server::Certainty::capped;
    within += outcome.true_error <= error;
    if (outcome.certainty != server::Certainty::converged) continue;
    ++claims;
    covered += outcome.true_error <= outcome.upper;
  }
  return {{"claims", claims},
          {"covered", covered},
          {"uncertain", uncertain},
          {"capped", capped},
          {"true_within_error", within}};
}

/// Returns the document of a scene. `bias` is that of the frame's mean luminance; `bias_share` is
/// the part of the mean squared error due to systematic differences of pixels from the reference.
ordered_json summary(const Options& options, const std::vector<Outcome>& outcomes,
                     const Reference& reference, const ImageMean& frames) {
  std::vector<double> bounds, estimates, samples, luminances, squares;
  for (const Outcome& outcome : outcomes) {
    if (outcome.true_error > 0) {
      bounds.push_back(outcome.upper / outcome.true_error);
      estimates.push_back(outcome.estimate / outcome.true_error);
    }
    samples.push_back(outcome.samples);
    luminances.push_back(outcome.luminance);
    squares.push_back(outcome.true_square);
  }
  const auto n = static_cast<double>(outcomes.size());
  const Moments light = moments(luminances), square = moments(squares);
  const double m = reference.luminance;
  const double systematic =
      true_square(frames.mean(), reference, m) - scaled_variance(frames.variance(), reference, m);
  ordered_json document = {{"scene", std::filesystem::path(options.scene).stem().string()},
                           {"error", options.settings.error.value_or(0)},
                           {"seeds", outcomes.size()}};
  document.update(counts(outcomes, options.settings.error.value_or(0)));
  document["median_upper_over_true"] = median(bounds);
  document["estimate_over_true"] = moments(estimates).mean;
  document["estimate_over_true_deviation"] = moments(estimates).deviation;
  document["true_square"] = square.mean;
  document["true_square_standard_error"] = square.deviation / std::sqrt(n);
  document["samples_mean"] = moments(samples).mean;
  document["bias"] = light.mean / m - 1;
  document["bias_standard_error"] =
      std::hypot(light.deviation / std::sqrt(n), reference.luminance_error) / m;
  document["bias_share"] = systematic / square.mean;
  document["reference_error"] = std::sqrt(scaled_variance(reference.variance, reference, m));
  return document;
}

absl::StatusOr<ordered_json> measure(const Options& options) {
  const double start = cpu_seconds();
  SeededRenderer renderer(options.scene, options.settings);
  if (absl::Status status = renderer.load(); !status.ok()) return status;
  const contract::TileGrid grid(options.settings);
  contract::RenderSettings plain = options.settings;
  plain.aovs = 0;  // render_fixed() merges blocks without layers
  SeededRenderer reference_renderer(options.scene, plain);
  if (absl::Status status = reference_renderer.load(); !status.ok()) return status;
  const auto reference = render_reference(reference_renderer, grid, options.reference_spp);
  if (!reference.ok()) return reference.status();
  const double reference_done = cpu_seconds();
  std::vector<Outcome> outcomes;
  ImageMean frames;
  Image image;
  for (int i = 0; i < options.seeds; ++i) {
    absl::Status status = renderer.use_seed(options.first_seed + static_cast<std::uint32_t>(i));
    if (!status.ok()) return status;
    auto outcome = options.fixed_spp > 0
                       ? render_once(renderer, grid, options, *reference, image)
                       : render_by_error(renderer, grid, options, *reference, image);
    if (!outcome.ok()) return outcome.status();
    outcome->true_error = std::sqrt(std::max(outcome->true_square, 0.0));
    outcomes.push_back(*outcome);
    frames.add(image);
  }
  ordered_json document = summary(options, outcomes, *reference, frames);
  document["cpu_seconds_per_seed"] = (cpu_seconds() - reference_done) / options.seeds;
  if (options.settings.denoise) {
    document["fixed_samples"] = nullptr;
  } else if (options.fixed_spp == 0) {
    const auto fixed = fixed_samples(renderer, grid, *reference, options.settings);
    document["fixed_samples"] = fixed.ok() ? ordered_json(*fixed) : nullptr;
  }
  document["cpu_seconds"] = cpu_seconds() - start;
  return document;
}

int run(const Options& options) {
  const auto document = measure(options);
  if (!document.ok()) {
    std::fprintf(stderr, "coverage: %s\n", document.status().ToString().c_str());
    return 2;
  }
  std::printf("%s\n", document->dump().c_str());
  return 0;
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  tessera::bench::Options o;
  double error = 0.1;
  CLI::App app("Compares what a job asked for by its error claims with the truth");
  tessera::bench::add_run_options(app, o, 4096);
  app.add_option("--error", error);
  app.add_option("--fixed", o.fixed_spp, "Frames of so many samples, whatever their error")
      ->check(CLI::Range(1, 1 << 20));
  app.add_flag("--denoise", o.settings.denoise, "Claims about denoised frames")
      ->excludes("--fixed");
  std::vector<float> background;
  app.add_option("--background", background, "R,G,B, which lights the scene too")
      ->delimiter(',')
      ->expected(3);
  CLI11_PARSE(app, argc, argv);
  if (!background.empty()) {
    o.settings.background = tessera::contract::Background::color;
    std::copy(background.begin(), background.end(), o.settings.background_color.begin());
  }
  if (o.settings.denoise) o.settings.aovs = tessera::contract::kAovDenoising;
  if (o.fixed_spp == 0) o.settings.error = error;
  return tessera::bench::run(o);
}
