/// tessera-bench-coverage: does what a job asked for by its error claims hold? Renders one scene
/// with many seeds through the film and the stopping rule of the farm, without the farm, and
/// compares each claim with the truth, against a reference of other seeds.

#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "proto/contract/pass_schedule.h"
#include "proto/contract/tile_grid.h"
#include "server/film/certainty.h"
#include "server/film/film_cache.h"
#include "tests/support/folder_reader.h"
#include "worker/render/frame_renderer.h"
#include "worker/scene/loader.h"

namespace tessera::bench {
namespace {

constexpr std::uint32_t kFirstReferenceSeed = 1'000'000'000;
constexpr int kReferenceSeeds = 16, kFixedSeeds = 6;

struct Options {
  std::string scene;
  contract::RenderSettings settings;
  int seeds = 400;
  std::uint32_t first_seed = 1;
  std::int32_t reference_spp = 8192;
};

std::size_t at(std::int64_t index) {
  return static_cast<std::size_t>(index);
}

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Renders the scene with one seed after the other; what they share is built once.
class Renderers {
 public:
  explicit Renderers(const Options& options) : options_(options) {}

  absl::Status load() {
    const std::filesystem::path path(options_.scene);
    reader_ = std::make_unique<testing::FolderReader>(
        path.has_parent_path() ? path.parent_path().string() : ".");
    auto file = render::load_scene_file(path.filename().string(), options_.settings, *reader_);
    if (!file.ok()) return file.status();
    file_ = *std::move(file);
    return use_seed(options_.first_seed);
  }
  absl::Status use_seed(std::uint32_t seed) {
    contract::RenderSettings settings = options_.settings;
    settings.seed = seed;
    auto scene = file_->pose(settings, 0);
    if (!scene.ok()) return scene.status();
    auto next = render::FrameRenderer::create(*std::move(scene), settings, 0, render::sequential(),
                                              renderer_.get());
    if (!next.ok()) return next.status();
    renderer_ = *std::move(next);
    return absl::OkStatus();
  }
  contract::FilmBlock render(const contract::PixelRect& rect, const contract::Pass& pass,
                             std::int32_t index) const {
    return renderer_->render(rect, pass, index, render::sequential());
  }

 private:
  const Options& options_;
  std::unique_ptr<testing::FolderReader> reader_;
  std::unique_ptr<render::SceneFile> file_;
  std::unique_ptr<render::FrameRenderer> renderer_;
};

/// R, G, B of the frame, row by row.
using Image = std::vector<double>;

void put_tile(const server::TileSum& sum, const contract::PixelRect& rect, std::int32_t width,
              Image& image) {
  for (std::int64_t pixel = 0; pixel < sum.pixel_count(); ++pixel) {
    float rgba[4];
    sum.rgba(pixel, rgba);
    const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
    for (std::size_t c = 0; c < 3; ++c) image[at(3 * (y * width + x)) + c] = rgba[c];
  }
}

double mean_luminance(const Image& image) {
  double sum = 0;
  for (std::size_t i = 0; i < image.size(); i += 3) {
    sum += 0.2126 * image[i] + 0.7152 * image[i + 1] + 0.0722 * image[i + 2];
  }
  return 3 * sum / static_cast<double>(image.size());
}

struct Reference {
  Image mean, variance;  // of the mean
  double luminance = 0;
};

/// Mean over pixels and channels of (x − ref)² less the reference's own variance, over
/// ref² + 0.01 m²: the square of the contract's error.
double true_square(const Image& image, const Reference& reference, double m) {
  double sum = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const double difference = image[i] - reference.mean[i];
    sum += (difference * difference - reference.variance[i]) /
           (reference.mean[i] * reference.mean[i] + 0.01 * m * m);
  }
  return sum / static_cast<double>(image.size());
}

/// A frame of a fixed sample count.
Image render_fixed(const Renderers& renderers, const contract::TileGrid& grid, std::int32_t spp) {
  const std::int32_t width = grid.window().width;
  Image image(at(std::int64_t{3} * width * grid.window().height));
  for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
    const contract::PixelRect rect = grid.rect(tile);
    server::TileSum sum(rect.width, rect.height, 0);
    std::int32_t index = 0;
    for (const contract::Pass& pass : contract::fixed_schedule(spp)) {
      sum.add(renderers.render(rect, pass, index++), pass).IgnoreError();
    }
    put_tile(sum, rect, width, image);
  }
  return image;
}

absl::StatusOr<Reference> render_reference(Renderers& renderers, const contract::TileGrid& grid,
                                           std::int32_t spp) {
  Reference reference;
  Image squares;
  for (int i = 0; i < kReferenceSeeds; ++i) {
    absl::Status status = renderers.use_seed(kFirstReferenceSeed + static_cast<std::uint32_t>(i));
    if (!status.ok()) return status;
    const Image image = render_fixed(renderers, grid, spp / kReferenceSeeds);
    reference.mean.resize(image.size());
    squares.resize(image.size());
    for (std::size_t k = 0; k < image.size(); ++k) {
      reference.mean[k] += image[k] / kReferenceSeeds;
      squares[k] += image[k] * image[k] / kReferenceSeeds;
    }
  }
  for (std::size_t k = 0; k < squares.size(); ++k) {
    const double spread = squares[k] - reference.mean[k] * reference.mean[k];
    reference.variance.push_back(std::max(spread, 0.0) / (kReferenceSeeds - 1));
  }
  reference.luminance = mean_luminance(reference.mean);
  return reference;
}

/// What one seed came to.
struct Outcome {
  server::Certainty certainty = server::Certainty::uncertain;
  double upper = 0, true_error = 0, samples = 0, luminance = 0;
};

/// The tiles' passes as the film demands them, as on a farm of one.
absl::Status render_on_demand(const Renderers& renderers, const contract::TileGrid& grid,
                              const std::vector<contract::Pass>& passes, server::FilmCache& film,
                              const server::FrameKey& key) {
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
        film.add(key, tile, pass, renderers.render(grid.rect(tile), passes[at(pass)], pass));
    if (!status.ok()) return status;
    const auto demands = film.take_demands(key);
    if (!demands.ok()) return demands.status();
    for (const auto& demand : *demands) want(demand.tile, demand.pass_count);
  }
  return absl::OkStatus();
}

absl::StatusOr<Outcome> render_by_error(Renderers& renderers, const contract::TileGrid& grid,
                                        const Options& options, const Reference& reference) {
  const server::FrameKey key{"job", 0};
  const auto passes = contract::schedule(options.settings);
  server::FilmCache film(std::int64_t{1} << 30);
  // Pass 0 of every tile comes before any pass 1, so no tile is read back.
  film.open_frame(key, options.settings, [](std::int32_t, std::int32_t) {
    return absl::StatusOr<contract::FilmBlock>(absl::InternalError("the film is kept whole"));
  });
  absl::Status status = render_on_demand(renderers, grid, passes, film, key);
  if (!status.ok()) return status;
  Outcome outcome;
  server::FrameStatistics statistics;
  const std::int32_t width = grid.window().width;
  Image image(reference.mean.size());
  const auto m = film.mean_luminance(key);
  if (!m.ok()) return m.status();
  statistics.mean_luminance = *m;
  statistics.estimated = film.running_estimate(key);
  const auto samples = film.expected_samples(key);
  outcome.samples = static_cast<double>(samples.value_or(0)) /
                    (static_cast<double>(width) * grid.window().height);
  for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
    const auto sum = film.tile(key, tile);
    if (!sum.ok()) return sum.status();
    statistics.dropped_samples += sum->dropped_count();
    put_tile(*sum, grid.rect(tile), width, image);
  }
  outcome.certainty =
      server::claim_of(statistics, film.stopping(key), *options.settings.error).certainty;
  outcome.upper = statistics.estimated.error_upper95;
  outcome.true_error = std::sqrt(std::max(true_square(image, reference, *m), 0.0));
  outcome.luminance = mean_luminance(image);
  return outcome;
}

/// Samples a pixel at which a fixed count just reaches `error`: root mean square over a few seeds
/// at powers of two, interpolated as a power of n.
absl::StatusOr<double> fixed_samples(Renderers& renderers, const contract::TileGrid& grid,
                                     const Reference& reference, double error) {
  double before = 0;
  for (std::int32_t spp = 8; spp <= 16384; spp *= 2) {
    double square = 0;
    for (std::uint32_t seed = 0; seed < kFixedSeeds; ++seed) {
      absl::Status status = renderers.use_seed(2 * kFirstReferenceSeed + seed);
      if (!status.ok()) return status;
      const Image image = render_fixed(renderers, grid, spp);
      square += true_square(image, reference, reference.luminance) / kFixedSeeds;
    }
    if (square <= error * error) {
      if (before == 0) return spp;  // or fewer
      const double slope = std::log2(before / square);
      return spp * std::exp2(-std::log2(error * error / square) / slope);
    }
    before = square;
  }
  return absl::OutOfRangeError("a fixed count of 16,384 does not reach the error");
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// The document of a scene.
nlohmann::ordered_json summary(const Options& options, const std::vector<Outcome>& outcomes,
                               const Reference& reference) {
  int claims = 0, covered = 0, within = 0, uncertain = 0, capped = 0;
  std::vector<double> ratios;
  double samples = 0, luminance = 0, squares = 0, reference_square = 0;
  for (const Outcome& outcome : outcomes) {
    uncertain += outcome.certainty == server::Certainty::uncertain;
    capped += outcome.certainty == server::Certainty::capped;
    within += outcome.true_error <= *options.settings.error;
    if (outcome.certainty == server::Certainty::converged) {
      ++claims;
      covered += outcome.true_error <= outcome.upper;
    }
    if (outcome.true_error > 0) ratios.push_back(outcome.upper / outcome.true_error);
    samples += outcome.samples;
    luminance += outcome.luminance;
    squares += outcome.luminance * outcome.luminance;
  }
  const auto n = static_cast<double>(outcomes.size());
  luminance /= n;
  for (std::size_t i = 0; i < reference.mean.size(); ++i) {
    reference_square += reference.variance[i] / (reference.mean[i] * reference.mean[i] +
                                                 0.01 * reference.luminance * reference.luminance);
  }
  reference_square /= static_cast<double>(reference.mean.size());
  return {{"scene", std::filesystem::path(options.scene).stem().string()},
          {"error", *options.settings.error},
          {"seeds", outcomes.size()},
          {"claims", claims},
          {"covered", covered},
          {"uncertain", uncertain},
          {"capped", capped},
          {"true_within_error", within},
          {"median_upper_over_true", median(ratios)},
          {"samples_mean", samples / n},
          {"bias", luminance / reference.luminance - 1},
          {"bias_standard_error",
           std::sqrt(std::max(squares / n - luminance * luminance, 0.0) / (n - 1)) /
               reference.luminance},
          {"reference_error", std::sqrt(reference_square)}};
}

int fail(const absl::Status& status) {
  std::fprintf(stderr, "coverage: %s\n", status.ToString().c_str());
  return 2;
}

int run(const Options& options) {
  const double start = cpu_seconds();
  Renderers renderers(options);
  if (absl::Status status = renderers.load(); !status.ok()) return fail(status);
  const contract::TileGrid grid(options.settings);
  const auto reference = render_reference(renderers, grid, options.reference_spp);
  if (!reference.ok()) return fail(reference.status());
  const auto fixed = fixed_samples(renderers, grid, *reference, *options.settings.error);
  std::vector<Outcome> outcomes;
  for (int i = 0; i < options.seeds; ++i) {
    absl::Status status = renderers.use_seed(options.first_seed + static_cast<std::uint32_t>(i));
    if (!status.ok()) return fail(status);
    const auto outcome = render_by_error(renderers, grid, options, *reference);
    if (!outcome.ok()) return fail(outcome.status());
    outcomes.push_back(*outcome);
  }
  nlohmann::ordered_json document = summary(options, outcomes, *reference);
  document["fixed_samples"] = fixed.ok() ? nlohmann::ordered_json(*fixed) : nullptr;
  document["cpu_seconds"] = cpu_seconds() - start;
  std::printf("%s\n", document.dump().c_str());
  return 0;
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  tessera::bench::Options o;
  o.settings.width = o.settings.height = 64;
  o.settings.tile = 16;
  o.settings.max_depth = 6;
  o.settings.spp = 4096;
  o.settings.error = 0.1;
  CLI::App app("Compares what a job asked for by its error claims with the truth");
  app.add_option("scene", o.scene)->required();
  app.add_option("--error", *o.settings.error);
  app.add_option("--max-spp", o.settings.spp);
  app.add_option("--seeds", o.seeds)->check(CLI::Range(2, 1'000'000));
  app.add_option("--first-seed", o.first_seed);
  app.add_option("--reference-spp", o.reference_spp)->check(CLI::Range(64, 1 << 20));
  app.add_option("--width", o.settings.width);
  app.add_option("--height", o.settings.height);
  app.add_option("--tile", o.settings.tile);
  app.add_option("--max-depth", o.settings.max_depth);
  CLI11_PARSE(app, argc, argv);
  return tessera::bench::run(o);
}
