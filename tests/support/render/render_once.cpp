/// tessera_render_once: renders one frame of a glTF file with the renderer's libraries alone,
/// without a farm. For looking at images, and as the baseline of tests/bench/farm_overhead.

#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "contract/digest.h"
#include "contract/pass_schedule.h"
#include "contract/tile_grid.h"
#include "image/codecs/image_codec.h"
#include "tests/support/render/assumed_features.h"
#include "tests/support/scene/folder_reader.h"
#include "worker/gltf/build/loader.h"
#include "worker/render/frame_renderer.h"
#include "worker/render/parallel_tbb.h"

namespace tessera::testing {
namespace {

struct Options {
  std::string scene, output, environment, background = "auto", size = "640x360", crop;
  contract::RenderSettings settings;
  std::int32_t frame = 0;
  int threads = 1;
  double exposure = 0;
  std::vector<std::string> assumed;  // names of features
};

double seconds(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// RGBA means of a window, row by row.
struct Film {
  contract::PixelRect window;
  std::vector<double> rgb, alpha, kept;
};

void add_block(const contract::PixelRect& rect, const contract::Pass& pass,
               const contract::FilmBlock& block, Film* film) {
  std::vector<double> kept(static_cast<std::size_t>(rect.width * rect.height), pass.sample_count);
  for (const auto& d : block.dropped) kept[d.pixel] -= d.count;
  for (std::int32_t y = 0; y < rect.height; ++y) {
    for (std::int32_t x = 0; x < rect.width; ++x) {
      const auto from = static_cast<std::size_t>(y * rect.width + x);
      const auto to = static_cast<std::size_t>(y + rect.y - film->window.y) *
                          static_cast<std::size_t>(film->window.width) +
                      static_cast<std::size_t>(x + rect.x - film->window.x);
      for (std::size_t r = 0; r < contract::kReplicates; ++r) {
        for (std::size_t c = 0; c < 3; ++c) {
          film->rgb[3 * to + c] += block.rgb[(from * contract::kReplicates + r) * 3 + c];
        }
      }
      film->alpha[to] += block.alpha[from];
      film->kept[to] += kept[from];
    }
  }
}

float encoded(double linear) {
  const double v = std::clamp(linear, 0.0, 1.0);
  return static_cast<float>(v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055);
}

/// Writes a Portable FloatMap: rows from the bottom, R, G and B little-endian.
bool write_pfm(const Options& options, const std::vector<float>& pixels, const Film& film) {
  std::ofstream file(options.output, std::ios::binary);
  file << "PF\n" << film.window.width << ' ' << film.window.height << "\n-1.0\n";
  for (std::int32_t y = film.window.height; y-- > 0;) {
    for (std::int32_t x = 0; x < film.window.width; ++x) {
      const auto pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(film.window.width) +
                         static_cast<std::size_t>(x);
      file.write(reinterpret_cast<const char*>(&pixels[4 * pixel]), 3 * sizeof(float));
    }
  }
  return file.flush().good();
}

/// Writes an sRGB PNG.
bool write_png(const Options& options, const std::vector<float>& pixels, const Film& film) {
  std::vector<std::uint8_t> codes;
  codes.reserve(pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const double shown = i % 4 == 3 ? std::clamp<double>(pixels[i], 0, 1)
                                    : encoded(std::exp2(options.exposure) * pixels[i]);
    codes.push_back(static_cast<std::uint8_t>(std::lround(255 * shown)));
  }
  const auto encoder =
      image::make_encoder(image::ImageFormat::png, film.window.width, film.window.height);
  if (!encoder->write_rows(codes.data(), film.window.height).ok()) return false;
  const auto file = encoder->finish();
  return file.ok() && (std::ofstream(options.output, std::ios::binary) << *file).flush().good();
}

int fail(const absl::Status& status) {
  std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return 2;
}

/// Renders all units of the frame like a worker, one unit per thread.
Film render_all(const render::FrameRenderer& renderer, const Options& options) {
  const contract::TileGrid grid(options.settings);
  const auto passes = contract::fixed_schedule(options.settings.spp);
  Film film;
  film.window = grid.window();
  const auto pixels =
      static_cast<std::size_t>(film.window.width) * static_cast<std::size_t>(film.window.height);
  film.rgb.assign(3 * pixels, 0);
  film.alpha.assign(pixels, 0);
  film.kept.assign(pixels, 0);
  std::vector<contract::FilmBlock> blocks(static_cast<std::size_t>(grid.tile_count()));
  const render::ParallelFor parallel = render::parallel_tbb(options.threads);
  for (std::size_t p = 0; p < passes.size(); ++p) {
    parallel(grid.tile_count(), [&](std::int64_t tile) {
      blocks[static_cast<std::size_t>(tile)] =
          renderer.render(grid.rect(static_cast<std::int32_t>(tile)), passes[p],
                          static_cast<std::int32_t>(p), render::sequential());
    });
    for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
      add_block(grid.rect(tile), passes[p], blocks[static_cast<std::size_t>(tile)], &film);
    }
  }
  return film;
}

std::vector<float> means(const Film& film) {
  std::vector<float> pixels;
  pixels.reserve(film.alpha.size() * 4);
  for (std::size_t i = 0; i < film.alpha.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      pixels.push_back(static_cast<float>(film.rgb[3 * i + c] / film.kept[i]));
    }
    pixels.push_back(static_cast<float>(film.alpha[i] / film.kept[i]));
  }
  return pixels;
}

int run(Options options) {
  const std::filesystem::path path(options.scene);
  FolderReader reader(path.has_parent_path() ? path.parent_path() : ".");
  if (!options.environment.empty()) {
    options.settings.environment = std::filesystem::absolute(options.environment).string();
  }
  const double start = seconds(CLOCK_MONOTONIC), start_cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
  auto file = render::load_scene_file(path.filename().string(), options.settings, reader);
  if (!file.ok()) return fail(file.status());
  for (const render::Problem& p : (*file)->problems()) {
    std::fprintf(stderr, "%s: %s\n", p.element.c_str(), p.message.c_str());
  }
  auto scene = (*file)->pose(options.settings, options.frame);
  if (!scene.ok()) return fail(scene.status());
  std::uint64_t assumed = 0;
  for (const std::string& name : options.assumed) assumed |= feature_named(name);
  const render::TraceOptions tracing = assume(assumed, &*scene);
  const double loaded = seconds(CLOCK_MONOTONIC);
  auto renderer =
      render::FrameRenderer::create(*std::move(scene), options.settings, options.frame,
                                    render::parallel_tbb(options.threads), nullptr, tracing);
  if (!renderer.ok()) return fail(renderer.status());
  const double built = seconds(CLOCK_MONOTONIC);
  const Film film = render_all(**renderer, options);
  const double done = seconds(CLOCK_MONOTONIC), cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
  const std::vector<float> pixels = means(film);
  double sum = 0;
  for (std::size_t i = 0; i < film.rgb.size(); ++i) sum += film.rgb[i] / film.kept[i / 3];
  std::printf("load %.3f s, build %.3f s, render %.3f s, cpu %.3f s, mean %.6f, sha256 %s\n",
              loaded - start, built - loaded, done - built, cpu - start_cpu,
              sum / static_cast<double>(film.rgb.size()),
              contract::sha256(std::as_bytes(std::span(pixels))).hex().c_str());
  const auto write = options.output.ends_with(".pfm") ? write_pfm : write_png;
  if (!options.output.empty() && !write(options, pixels, film)) {
    std::fprintf(stderr, "%s: cannot be written\n", options.output.c_str());
    return 1;
  }
  return 0;
}

bool parse_size(const std::string& text, contract::RenderSettings* s) {
  return std::sscanf(text.c_str(), "%dx%d", &s->width, &s->height) == 2;
}

bool parse_crop(const std::string& text, contract::RenderSettings* s) {
  if (text.empty()) return true;
  contract::PixelRect r;
  const bool ok = std::sscanf(text.c_str(), "%d,%d,%d,%d", &r.x, &r.y, &r.width, &r.height) == 4;
  s->crop = r;
  return ok;
}

bool parse_background(const std::string& text, contract::RenderSettings* s) {
  if (text == "auto") return true;
  s->background = text == "none" ? contract::Background::none : contract::Background::color;
  auto& c = s->background_color;
  return text == "none" || std::sscanf(text.c_str(), "%f,%f,%f", &c[0], &c[1], &c[2]) == 3;
}

}  // namespace
}  // namespace tessera::testing

int main(int argc, char** argv) {
  tessera::testing::Options o;
  CLI::App app("Renders one frame without a farm");
  app.add_option("scene", o.scene)->required();
  app.add_option("-o", o.output, "PNG, or .pfm of the pixels themselves");
  app.add_option("--size", o.size);
  app.add_option("--crop", o.crop);
  app.add_option("--spp", o.settings.spp);
  app.add_option("--seed", o.settings.seed);
  app.add_option("--tile", o.settings.tile);
  app.add_option("--threads", o.threads);
  app.add_option("--max-depth", o.settings.max_depth);
  app.add_option("--frame", o.frame);
  app.add_option("--camera", o.settings.camera);
  app.add_option("--environment", o.environment);
  app.add_option("--environment-rotation", o.settings.environment_rotation);
  app.add_option("--background", o.background, "R,G,B, none or auto");
  app.add_option("--exposure", o.exposure, "Stops");
  app.add_flag("--cull-backfaces", o.settings.cull_backfaces);
  app.add_flag("--guiding", o.settings.guiding);
  app.add_option("--assume", o.assumed, "Features that everything is taken to have")
      ->delimiter(',')
      ->check([](const std::string& name) {
        return tessera::testing::feature_named(name) == 0 ? "no such feature: " + name : "";
      });
  CLI11_PARSE(app, argc, argv);
  if (!tessera::testing::parse_size(o.size, &o.settings) ||
      !tessera::testing::parse_crop(o.crop, &o.settings) ||
      !tessera::testing::parse_background(o.background, &o.settings)) {
    std::fprintf(stderr, "bad --size, --crop or --background\n");
    return 2;
  }
  return tessera::testing::run(std::move(o));
}
