/// tessera-bench-denoise: how much denoising lowers the error of a scene, and whether its own
/// estimate holds. Renders a scene with several seeds at several sample counts, denoises each
/// frame, and compares with a reference of other seeds.

#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "contract/index.h"
#include "contract/pass_schedule.h"
#include "image/denoise/denoiser.h"
#include "tests/bench/coverage/reference.h"

namespace tessera::bench {
namespace {

using nlohmann::ordered_json;
using testing::SeededRenderer;

struct Options {
  std::string scene;
  contract::RenderSettings settings;
  std::vector<int> counts = {16, 64, 256};
  int seeds = 4;
  std::int32_t reference_spp = 4096;
};

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// A frame as the server has it, and the planes that denoising reads.
struct Frame {
  Image raw;
  std::vector<std::vector<float>> planes;
  contract::ErrorSums sums;
};

absl::StatusOr<Frame> render(const SeededRenderer& renderer, const contract::TileGrid& grid,
                             std::int32_t spp, double m) {
  const std::int32_t width = grid.window().width;
  const std::size_t pixels = contract::as_index(std::int64_t{width} * grid.window().height);
  Frame frame;
  frame.raw.resize(3 * pixels);
  frame.planes.assign(image::kDenoiseInputs, std::vector<float>(pixels));
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    const contract::PixelRect rect = grid.rect(index);
    server::TileSum tile(rect.width, rect.height, contract::kAovDenoising);
    std::int32_t pass_index = 0;
    for (const contract::Pass& pass : contract::fixed_schedule(spp)) {
      absl::Status status = tile.add(renderer.render(rect, pass, pass_index++), pass);
      if (!status.ok()) return status;
    }
    testing::put_tile(tile, rect, width, frame.raw);
    frame.sums.add(tile.error_sums(m));
    for (std::int64_t pixel = 0; pixel < tile.pixel_count(); ++pixel) {
      const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
      const std::size_t to = contract::as_index(y * width + x);
      const server::TileSum::DenoisingValues values = tile.denoising_values(pixel);
      std::size_t plane = 0;
      for (std::size_t r = 0; r < contract::kReplicates; ++r) {
        for (const float value : values.rgb[r]) frame.planes[plane++][to] = value;
        for (const float value : values.features[r]) frame.planes[plane++][to] = value;
      }
    }
  }
  return frame;
}

struct Denoised {
  Image image;
  image::DenoiseSums sums;
};

Denoised denoise(const Frame& frame, const contract::PixelRect& window, double m) {
  image::DenoiseRows rows;
  for (std::size_t k = 0; k < frame.planes.size(); ++k) rows.planes[k] = frame.planes[k].data();
  const contract::PixelRect all{0, 0, window.width, window.height};
  image::Denoiser denoiser({window.width, window.height, m}, all, 1);
  Denoised result{frame.raw, {}};
  std::size_t to = 0;
  while (to < result.image.size()) {
    const image::DenoisedRows band = denoiser.next(rows);
    for (std::size_t i = 0; i < band.is_raw.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c, ++to) {
        if (band.is_raw[i] == 0) result.image[to] = band.rgb[c][i];
      }
    }
  }
  result.sums = denoiser.sums();
  return result;
}

/// Sums over the seeds of one sample count.
struct Totals {
  double raw = 0, denoised = 0;       // relMSE
  double raw_square = 0, square = 0;  // of the contract's error, true
  double estimate = 0, raw_share = 0, seconds = 0;
  int claims = 0, held = 0;
};

absl::Status add_seed(const SeededRenderer& renderer, const contract::TileGrid& grid,
                      std::int32_t spp, const Reference& reference, Totals& totals) {
  const double m = reference.luminance;
  const auto frame = render(renderer, grid, spp, m);
  if (!frame.ok()) return frame.status();
  const double start = cpu_seconds();
  const Denoised denoised = denoise(*frame, grid.window(), m);
  totals.seconds += cpu_seconds() - start;
  const image::DenoisedError error = image::denoised_error(denoised.sums);
  const double square = true_square(denoised.image, reference, m);
  totals.raw += testing::relative_square(frame->raw, reference.mean, reference.variance);
  totals.denoised += testing::relative_square(denoised.image, reference.mean, reference.variance);
  totals.raw_square += true_square(frame->raw, reference, m);
  totals.square += square;
  totals.estimate += error.error * error.error;
  totals.raw_share += error.raw_share;
  constexpr double kMinEffectivePixels = 30;
  const bool claims = error.n_eff >= kMinEffectivePixels &&
                      contract::effective_pixels(frame->sums) >= kMinEffectivePixels;
  totals.claims += claims ? 1 : 0;
  totals.held += claims && error.error_upper95 * error.error_upper95 >= square ? 1 : 0;
  return absl::OkStatus();
}

int run(const Options& options) {
  contract::RenderSettings plain = options.settings;
  SeededRenderer reference_renderer(options.scene, plain);
  contract::RenderSettings settings = options.settings;
  settings.aovs = contract::kAovDenoising;
  SeededRenderer renderer(options.scene, settings);
  absl::Status status = reference_renderer.load();
  if (status.ok()) status = renderer.load();
  const contract::TileGrid grid(settings);
  const auto reference = status.ok()
                             ? render_reference(reference_renderer, grid, options.reference_spp)
                             : absl::StatusOr<Reference>(status);
  if (!reference.ok()) {
    std::fprintf(stderr, "denoise: %s\n", reference.status().ToString().c_str());
    return 2;
  }
  const double pixels = static_cast<double>(grid.window().width) * grid.window().height;
  for (const int spp : options.counts) {
    Totals totals;
    for (int seed = 1; seed <= options.seeds && status.ok(); ++seed) {
      status = renderer.use_seed(static_cast<std::uint32_t>(seed));
      if (status.ok()) status = add_seed(renderer, grid, spp, *reference, totals);
    }
    if (!status.ok()) {
      std::fprintf(stderr, "denoise: %s\n", status.ToString().c_str());
      return 2;
    }
    const ordered_json row = {
        {"scene", std::filesystem::path(options.scene).stem().string()},
        {"width", grid.window().width},
        {"height", grid.window().height},
        {"spp", spp},
        {"seeds", options.seeds},
        {"relmse_raw", totals.raw / options.seeds},
        {"relmse_denoised", totals.denoised / options.seeds},
        {"error_raw", std::sqrt(std::max(totals.raw_square, 0.0) / options.seeds)},
        {"error_denoised", std::sqrt(std::max(totals.square, 0.0) / options.seeds)},
        {"error_estimated", std::sqrt(totals.estimate / options.seeds)},
        {"claims", totals.claims},
        {"held", totals.held},
        {"raw_share", totals.raw_share / options.seeds},
        {"seconds_per_megapixel", 1e6 * totals.seconds / (pixels * options.seeds)}};
    std::printf("%s\n", row.dump().c_str());
  }
  return 0;
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  tessera::bench::Options o;
  o.settings.width = o.settings.height = 64;
  o.settings.max_depth = 6;
  CLI::App app("Measures what denoising does to the error of a scene");
  app.add_option("scene", o.scene)->required();
  app.add_option("--spp", o.counts, "Sample counts per pixel")->delimiter(',');
  app.add_option("--seeds", o.seeds)->check(CLI::Range(1, 100'000));
  app.add_option("--reference-spp", o.reference_spp)->check(CLI::Range(64, 1 << 20));
  app.add_option("--width", o.settings.width);
  app.add_option("--height", o.settings.height);
  app.add_option("--max-depth", o.settings.max_depth);
  CLI11_PARSE(app, argc, argv);
  return tessera::bench::run(o);
}
