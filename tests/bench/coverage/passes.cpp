/// tessera-bench-passes: stores the replicate means of every pixel after every pass, for many seeds
/// of one scene, so that replay.py can try stopping rules on them without rendering again.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "contract/index.h"
#include "contract/pass_schedule.h"
#include "tests/bench/coverage/reference.h"
#include "tests/bench/coverage/run_options.h"

namespace tessera::bench {
namespace {

using contract::as_index;
using testing::SeededRenderer;

struct PassOptions : RunOptions {
  std::string out;
};

/// Adds a tile's block to the sums of the frame: 3 * kReplicates values per pixel.
void add_block(const contract::FilmBlock& block, const contract::PixelRect& rect,
               std::int32_t width, std::vector<double>& sums) {
  constexpr std::size_t kValues = std::size_t{3} * contract::kReplicates;
  for (std::int64_t pixel = 0; pixel < block.shape.pixel_count(); ++pixel) {
    const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
    double* to = &sums[kValues * as_index(y * width + x)];
    const float* from = &block.rgb[kValues * as_index(pixel)];
    for (std::size_t i = 0; i < kValues; ++i) to[i] += from[i];
  }
}

void write_seed(const SeededRenderer& renderer, const contract::TileGrid& grid,
                const contract::RenderSettings& settings, std::ofstream& out) {
  const auto passes = contract::error_schedule(settings.spp);
  const std::int64_t pixels = std::int64_t{grid.window().width} * grid.window().height;
  std::vector<double> sums(as_index(3 * contract::kReplicates * pixels));
  std::vector<float> means(sums.size());
  for (std::int32_t pass = 0; pass < static_cast<std::int32_t>(passes.size()); ++pass) {
    for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
      const contract::PixelRect rect = grid.rect(tile);
      add_block(renderer.render(rect, passes[as_index(pass)], pass), rect, grid.window().width,
                sums);
    }
    const double count = passes[as_index(pass)].end() / double{contract::kReplicates};
    for (std::size_t i = 0; i < sums.size(); ++i) means[i] = static_cast<float>(sums[i] / count);
    out.write(reinterpret_cast<const char*>(means.data()),
              static_cast<std::streamsize>(means.size() * sizeof(float)));
  }
}

void write_image(const Image& image, std::ofstream& out) {
  out.write(reinterpret_cast<const char*>(image.data()),
            static_cast<std::streamsize>(image.size() * sizeof(double)));
}

/// Writes a line of JSON, the reference's mean and variance in double, and for each seed and pass
/// the means in float.
absl::Status write_passes(const PassOptions& options) {
  SeededRenderer renderer(options.scene, options.settings);
  if (absl::Status status = renderer.load(); !status.ok()) return status;
  const contract::TileGrid grid(options.settings);
  const auto reference = render_reference(renderer, grid, options.reference_spp);
  if (!reference.ok()) return reference.status();
  std::ofstream out(options.out, std::ios::binary);
  nlohmann::ordered_json totals;
  for (const auto& pass : contract::error_schedule(options.settings.spp))
    totals.push_back(pass.end());
  out << nlohmann::ordered_json{{"width", grid.window().width},
                                {"height", grid.window().height},
                                {"tile", options.settings.tile},
                                {"seeds", options.seeds},
                                {"totals", totals}}
             .dump()
      << '\n';
  write_image(reference->mean, out);
  write_image(reference->variance, out);
  for (int i = 0; i < options.seeds; ++i) {
    absl::Status status = renderer.use_seed(options.first_seed + static_cast<std::uint32_t>(i));
    if (!status.ok()) return status;
    write_seed(renderer, grid, options.settings, out);
    out.flush();
  }
  return out ? absl::OkStatus() : absl::DataLossError("cannot write " + options.out);
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  tessera::bench::PassOptions o;
  o.seeds = 100;
  CLI::App app("Stores the replicate means after every pass");
  tessera::bench::add_run_options(app, o, 256);
  app.add_option("out", o.out)->required();
  CLI11_PARSE(app, argc, argv);
  const absl::Status status = tessera::bench::write_passes(o);
  if (!status.ok()) std::fprintf(stderr, "passes: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 2;
}
