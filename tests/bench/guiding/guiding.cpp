/// tessera-bench-guiding: relMSE against a guided reference, and CPU seconds, of one scene with and
/// without path guiding. Both are rendered one after the other for each seed.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/bench/coverage/reference.h"
#include "tests/support/cpu_seconds.h"
#include "tests/support/render/seeded_frames.h"

namespace tessera::bench {
namespace {

using nlohmann::ordered_json;
using testing::cpu_seconds;
using testing::SeededRenderer;

struct Options {
  std::string scene;
  contract::RenderSettings settings;
  int seeds = 8, spp = 64, guided_spp = 64, reference_spp = 16384;
  std::string reference_file;  // empty: the reference is not kept
};

/// Reads a reference of `count` values that write_reference() wrote; false if there is none.
bool read_reference(const std::string& path, std::size_t count, Reference& reference) {
  std::ifstream file(path, std::ios::binary);
  reference.mean.resize(count);
  reference.variance.resize(count);
  for (Image* image : {&reference.mean, &reference.variance}) {
    file.read(reinterpret_cast<char*>(image->data()),
              static_cast<std::streamsize>(count * sizeof(double)));
  }
  return static_cast<bool>(file) && file.peek() == std::ifstream::traits_type::eof();
}

void write_reference(const std::string& path, const Reference& reference) {
  std::ofstream file(path, std::ios::binary);
  for (const Image* image : {&reference.mean, &reference.variance}) {
    file.write(reinterpret_cast<const char*>(image->data()),
               static_cast<std::streamsize>(image->size() * sizeof(double)));
  }
}

/// The reference in the file, or a new one, which is written to the file.
absl::StatusOr<Reference> reference_of(SeededRenderer& guided, const contract::TileGrid& grid,
                                       const Options& options) {
  Reference kept;
  const auto count = static_cast<std::size_t>(options.settings.width) *
                     static_cast<std::size_t>(options.settings.height) * 3;
  if (!options.reference_file.empty() && read_reference(options.reference_file, count, kept)) {
    kept.luminance = testing::mean_luminance(kept.mean);
    return kept;
  }
  auto made = render_reference(guided, grid, options.reference_spp);
  if (made.ok() && !options.reference_file.empty()) write_reference(options.reference_file, *made);
  return made;
}

/// relMSE that a reference has by its own variance.
double own_relative_square(const Reference& reference) {
  double sum = 0;
  for (std::size_t i = 0; i < reference.mean.size(); ++i) {
    sum += reference.variance[i] / (reference.mean[i] * reference.mean[i] + 0.01);
  }
  return sum / static_cast<double>(reference.mean.size());
}

/// Figures of the seeds rendered in one way.
struct Runs {
  std::vector<double> errors;  // relMSE
  double build = 0, render = 0;
};

absl::Status add_run(SeededRenderer& renderer, const contract::TileGrid& grid, std::uint32_t seed,
                     int spp, const Reference& reference, Runs& runs) {
  const double start = cpu_seconds();
  absl::Status status = renderer.use_seed(seed);
  if (!status.ok()) return status;
  const double built = cpu_seconds();
  const Image image = testing::render_fixed(renderer, grid, spp, 0).image;
  runs.build += built - start;
  runs.render += cpu_seconds() - built;
  runs.errors.push_back(testing::relative_square(image, reference.mean, reference.variance));
  return absl::OkStatus();
}

ordered_json json_of(const Runs& runs, int spp) {
  const auto count = static_cast<double>(runs.errors.size());
  double mean = 0, square = 0;
  for (const double error : runs.errors) mean += error / count;
  for (const double error : runs.errors) square += (error - mean) * (error - mean);
  return {{"spp", spp},
          {"relmse", mean},
          {"relmse_error", std::sqrt(square / (count * std::max(count - 1, 1.0)))},
          {"build_seconds", runs.build / count},
          {"render_seconds", runs.render / count}};
}

int run(const Options& options) {
  contract::RenderSettings guided_settings = options.settings;
  guided_settings.guiding = true;
  SeededRenderer plain(options.scene, options.settings), guided(options.scene, guided_settings);
  absl::Status status = plain.load();
  if (status.ok()) status = guided.load();
  const contract::TileGrid grid(options.settings);
  const auto reference =
      status.ok() ? reference_of(guided, grid, options) : absl::StatusOr<Reference>(status);
  Runs plain_runs, guided_runs;
  status = reference.status();
  for (int seed = 1; seed <= options.seeds && status.ok(); ++seed) {
    const auto number = static_cast<std::uint32_t>(seed);
    status = add_run(plain, grid, number, options.spp, *reference, plain_runs);
    if (!status.ok()) break;
    status = add_run(guided, grid, number, options.guided_spp, *reference, guided_runs);
  }
  if (!status.ok()) {
    std::fprintf(stderr, "guiding: %s\n", status.ToString().c_str());
    return 2;
  }
  const ordered_json row = {{"scene", std::filesystem::path(options.scene).stem().string()},
                            {"width", options.settings.width},
                            {"height", options.settings.height},
                            {"seeds", options.seeds},
                            {"reference_relmse", own_relative_square(*reference)},
                            {"reference_mean", reference->luminance},
                            {"plain", json_of(plain_runs, options.spp)},
                            {"guided", json_of(guided_runs, options.guided_spp)}};
  std::printf("%s\n", row.dump().c_str());
  return 0;
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  tessera::bench::Options o;
  o.settings.width = o.settings.height = 64;
  o.settings.max_depth = 8;
  CLI::App app("Measures what path guiding does to the error and the CPU time of a scene");
  app.add_option("scene", o.scene)->required();
  app.add_option("--spp", o.spp, "Samples per pixel without guiding")
      ->check(CLI::Range(4, 1 << 20));
  app.add_option("--guided-spp", o.guided_spp)->check(CLI::Range(4, 1 << 20));
  app.add_option("--seeds", o.seeds)->check(CLI::Range(1, 100'000));
  app.add_option("--reference-spp", o.reference_spp)->check(CLI::Range(64, 1 << 20));
  app.add_option("--reference", o.reference_file,
                 "File from which the reference is read, or to which it is written");
  app.add_option("--width", o.settings.width);
  app.add_option("--height", o.settings.height);
  app.add_option("--max-depth", o.settings.max_depth);
  app.add_option("--environment", o.settings.environment, "A file in the scene's folder");
  app.add_option("--environment-strength", o.settings.environment_strength);
  CLI11_PARSE(app, argc, argv);
  return tessera::bench::run(o);
}
