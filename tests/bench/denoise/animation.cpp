/// tessera-bench-animation: compares frames of an animation that are denoised alone with frames
/// that are denoised with their neighbours: error, its bound, and ghosts.

#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "contract/index.h"
#include "contract/pass_schedule.h"
#include "image/denoise/frame_denoiser.h"
#include "image/denoise/layers.h"
#include "tests/bench/coverage/reference.h"

namespace tessera::bench {
namespace {

using image::ExrPlane;
using nlohmann::ordered_json;
using testing::SeededRenderer;

constexpr std::uint32_t kAovs = contract::kAovDenoising | contract::kAovMotion;

struct Options {
  std::string scene, pictures;
  contract::RenderSettings settings;
  int first = 8, count = 3, spp = 16, seeds = 4, threads = 1;
  std::int32_t reference_spp = 2048;
};

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// The channels of a rendered frame, as in its EXR file.
std::vector<ExrPlane> empty_planes(std::size_t pixels) {
  std::vector<ExrPlane> planes;
  const auto add = [&](const std::string& name) {
    planes.push_back({name, image::ExrType::float32, std::vector<float>(pixels), {}});
  };
  for (const char* name : {"R", "G", "B"}) add(name);
  for (const char* name : image::kMotionChannels) add(name);
  for (int r = 0; r < contract::kReplicates; ++r) {
    for (const char* name : image::kDenoisingChannels)
      add(image::kDenoisingPrefix + std::to_string(r) + "." + name);
  }
  return planes;
}

absl::StatusOr<std::vector<ExrPlane>> render(const SeededRenderer& renderer,
                                             const contract::TileGrid& grid, std::int32_t spp) {
  const std::int32_t width = grid.window().width;
  auto planes = empty_planes(contract::as_index(std::int64_t{width} * grid.window().height));
  for (std::int32_t index = 0; index < grid.tile_count(); ++index) {
    const contract::PixelRect rect = grid.rect(index);
    server::TileSum tile(rect.width, rect.height, kAovs);
    std::int32_t pass_index = 0;
    for (const contract::Pass& pass : contract::fixed_schedule(spp)) {
      absl::Status status = tile.add(renderer.render(rect, pass, pass_index++), pass);
      if (!status.ok()) return status;
    }
    for (std::int64_t pixel = 0; pixel < tile.pixel_count(); ++pixel) {
      const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
      std::size_t plane = 0;
      const auto put = [&](const float* values, std::size_t count) {
        for (std::size_t k = 0; k < count; ++k)
          planes[plane++].values[contract::as_index(y * width + x)] = values[k];
      };
      float rgba[4];
      tile.rgba(pixel, rgba);
      put(rgba, 3);
      put(&tile.first_sample().motion[4 * contract::as_index(pixel)], 4);
      const server::TileSum::DenoisingValues values = tile.denoising_values(pixel);
      for (std::size_t r = 0; r < contract::kReplicates; ++r) {
        put(values.rgb[r].data(), values.rgb[r].size());
        put(values.features[r].data(), values.features[r].size());
      }
    }
  }
  return planes;
}

Image image_of(const std::vector<ExrPlane>& planes) {
  Image image;
  for (std::size_t i = 0; i < planes[0].values.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) image.push_back(planes[c].values[i]);
  }
  return image;
}

struct Denoised {
  Image image;
  image::DenoisedError error;
};

Denoised denoise(const std::vector<ExrPlane>& planes, const contract::PixelRect& window, double m,
                 int threads, const image::AnimationInput* animation) {
  image::FrameDenoiser denoiser(window.width, window.height, m, planes, threads, animation);
  Denoised result;
  const auto sink = [&](std::int32_t rows, const std::vector<ExrPlane>& band) {
    for (std::size_t i = 0; i < contract::as_index(std::int64_t{rows} * window.width); ++i) {
      for (std::size_t c = 0; c < 3; ++c) result.image.push_back(band[c].values[i]);
    }
    return absl::OkStatus();
  };
  denoiser.push(window.height, planes, sink).IgnoreError();
  result.error = denoiser.error();
  return result;
}

/// The fraction of the change towards the neighbours' mean that is in the image: 2/3 for the plain
/// mean of three frames, 0 without ghosts. The least-squares fit over all pixels and channels that
/// change by less than half, so that the lamp itself does not outweigh what it lights. The
/// references' noise, which is in the change and in the difference, is subtracted.
double ghost(const Image& image, const Reference& at, const Reference& before,
             const Reference& after) {
  double product = 0, square = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const double weight = 1 / (at.mean[i] * at.mean[i] + 0.01);
    const double change = 0.5 * (before.mean[i] + after.mean[i]) - at.mean[i];
    if (std::fabs(change) > 0.5 * (at.mean[i] + 0.1)) continue;
    product += weight * (change * (image[i] - at.mean[i]) - at.variance[i]);
    square += weight *
              (change * change - at.variance[i] - 0.25 * (before.variance[i] + after.variance[i]));
  }
  return product / square;
}

/// Results of one way of denoising, over the seeds.
struct Totals {
  std::vector<double> relmse, ghosts;
  double square = 0, estimate = 0, seconds = 0;
  int held = 0;

  void add(const Denoised& denoised, const std::vector<Reference>& references, std::size_t frame,
           double m) {
    const Reference& reference = references[frame];
    relmse.push_back(testing::relative_square(denoised.image, reference.mean, reference.variance));
    ghosts.push_back(
        ghost(denoised.image, reference, references[frame - 1], references[frame + 1]));
    const double true_error = true_square(denoised.image, reference, m);
    square += true_error;
    estimate += denoised.error.error * denoised.error.error;
    held += denoised.error.error_upper95 * denoised.error.error_upper95 >= true_error ? 1 : 0;
  }
};

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

/// Standard error of the mean.
double deviation(const std::vector<double>& values) {
  const double centre = mean(values);
  double sum = 0;
  for (const double value : values) sum += (value - centre) * (value - centre);
  const auto count = static_cast<double>(values.size());
  return values.size() < 2 ? 0 : std::sqrt(sum / (count * (count - 1)));
}

/// Writes an image as PPM, with a gamma of 2.2.
void write_picture(const std::string& path, const Image& image, std::int32_t width,
                   std::int32_t height) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) return;
  std::fprintf(file, "P6 %d %d 255\n", width, height);
  for (const double value : image) {
    const double shown = std::pow(std::clamp(value, 0.0, 1.0), 1 / 2.2);
    std::fputc(static_cast<int>(std::lround(255 * shown)), file);
  }
  std::fclose(file);
}

/// Denoises the middle frames of an animation with one seed.
class Comparison {
 public:
  Comparison(const Options& options, const contract::PixelRect& window,
             const std::vector<Reference>& references)
      : options_(options), window_(window), references_(references) {}

  absl::Status add_seed(SeededRenderer& renderer, const contract::TileGrid& grid,
                        std::uint32_t seed) {
    std::vector<std::vector<ExrPlane>> frames;
    for (int k = 0; k < options_.count; ++k) {
      renderer.set_frame(options_.first + k);
      absl::Status status = renderer.use_seed(seed);
      auto planes = status.ok() ? render(renderer, grid, options_.spp)
                                : absl::StatusOr<std::vector<ExrPlane>>(status);
      if (!planes.ok()) return planes.status();
      frames.push_back(*std::move(planes));
    }
    compare(frames, seed == 1);
    return absl::OkStatus();
  }

  ordered_json row(const Totals& totals, const char* name) const {
    const auto count = static_cast<double>(totals.relmse.size());
    const double pixels = static_cast<double>(window_.width) * window_.height;
    return {{"image", name},
            {"relmse", mean(totals.relmse)},
            {"relmse_stderr", deviation(totals.relmse)},
            {"ghost", mean(totals.ghosts)},
            {"ghost_stderr", deviation(totals.ghosts)},
            {"error", std::sqrt(std::max(totals.square, 0.0) / count)},
            {"error_estimated", std::sqrt(totals.estimate / count)},
            {"bounds", totals.relmse.size()},
            {"held", totals.held},
            {"seconds_per_megapixel", 1e6 * totals.seconds / (pixels * count)}};
  }

  void print() const {
    for (const auto& [totals, name] : {std::pair(&raw_, "raw"), std::pair(&alone_, "alone"),
                                       std::pair(&animation_, "animation")})
      std::printf("%s\n", row(*totals, name).dump().c_str());
  }

 private:
  void compare(const std::vector<std::vector<ExrPlane>>& frames, bool draws) {
    std::vector<image::AnimationFrame> loaded;
    double start = cpu_seconds();
    for (std::size_t k = 0; k < frames.size(); ++k) {
      loaded.push_back(image::animation_frame(
          window_.width, window_.height, references_[k].luminance, frames[k], options_.threads));
    }
    const double guides = (cpu_seconds() - start) / static_cast<double>(frames.size());
    for (std::size_t k = 1; k + 1 < frames.size(); ++k) {
      const double m = references_[k].luminance;
      const Denoised raw{image_of(frames[k]), {}};
      start = cpu_seconds();
      const Denoised alone = denoise(frames[k], window_, m, options_.threads, nullptr);
      alone_.seconds += cpu_seconds() - start;
      start = cpu_seconds();
      const image::FusedFrame fused =
          image::fuse_frames(loaded[k], &loaded[k - 1], &loaded[k + 1], options_.threads);
      const image::AnimationInput input{loaded[k], fused};
      const Denoised animation = denoise(frames[k], window_, m, options_.threads, &input);
      animation_.seconds += guides + cpu_seconds() - start;
      raw_.add(raw, references_, k, m);
      alone_.add(alone, references_, k, m);
      animation_.add(animation, references_, k, m);
      if (!draws || options_.pictures.empty()) continue;
      draw("raw", k, raw.image);
      draw("alone", k, alone.image);
      draw("animation", k, animation.image);
      draw("reference", k, references_[k].mean);
    }
  }

  void draw(const std::string& name, std::size_t frame, const Image& image) const {
    write_picture(options_.pictures + "/" + std::to_string(frame) + "_" + name + ".ppm", image,
                  window_.width, window_.height);
  }

  const Options& options_;
  const contract::PixelRect window_;
  const std::vector<Reference>& references_;
  Totals raw_, alone_, animation_;
};

absl::Status measure(const Options& options) {
  SeededRenderer reference_renderer(options.scene, options.settings);
  contract::RenderSettings settings = options.settings;
  settings.aovs = kAovs;
  SeededRenderer renderer(options.scene, settings);
  absl::Status status = reference_renderer.load();
  if (status.ok()) status = renderer.load();
  if (!status.ok()) return status;
  const contract::TileGrid grid(settings);
  std::vector<Reference> references;
  for (int k = 0; k < options.count; ++k) {
    reference_renderer.set_frame(options.first + k);
    auto reference = render_reference(reference_renderer, grid, options.reference_spp);
    if (!reference.ok()) return reference.status();
    references.push_back(*std::move(reference));
  }
  Comparison comparison(options, grid.window(), references);
  for (int seed = 1; seed <= options.seeds; ++seed) {
    status = comparison.add_seed(renderer, grid, static_cast<std::uint32_t>(seed));
    if (!status.ok()) return status;
  }
  comparison.print();
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  tessera::bench::Options o;
  o.settings.width = 128;
  o.settings.height = 96;
  o.settings.max_depth = 6;
  CLI::App app("Compares frames that are denoised alone and with their neighbours");
  app.add_option("scene", o.scene)->required();
  app.add_option("--camera", o.settings.camera);
  app.add_option("--first", o.first, "First frame");
  app.add_option("--count", o.count, "Frames; all but the first and last are denoised")
      ->check(CLI::Range(3, 1000));
  app.add_option("--spp", o.spp);
  app.add_option("--seeds", o.seeds)->check(CLI::Range(1, 100'000));
  app.add_option("--reference-spp", o.reference_spp)->check(CLI::Range(64, 1 << 20));
  app.add_option("--width", o.settings.width);
  app.add_option("--height", o.settings.height);
  app.add_option("--max-depth", o.settings.max_depth);
  app.add_option("--threads", o.threads);
  app.add_option("--pictures", o.pictures, "Folder for pictures of the first seed");
  CLI11_PARSE(app, argc, argv);
  const absl::Status status = tessera::bench::measure(o);
  if (!status.ok()) std::fprintf(stderr, "animation: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 2;
}
