#include "tests/support/render/seeded_frames.h"

#include <filesystem>
#include <utility>

#include "contract/index.h"
#include "contract/pass_schedule.h"

namespace tessera::testing {
namespace {}  // namespace

absl::Status SeededRenderer::load() {
  const std::filesystem::path path(scene_);
  reader_ =
      std::make_unique<FolderReader>(path.has_parent_path() ? path.parent_path().string() : ".");
  auto file = render::load_scene_file(path.filename().string(), settings_, *reader_);
  if (!file.ok()) return file.status();
  file_ = *std::move(file);
  return use_seed(1);
}

absl::Status SeededRenderer::use_seed(std::uint32_t seed) {
  contract::RenderSettings settings = settings_;
  settings.seed = seed;
  auto scene = file_->pose(settings, frame_);
  if (!scene.ok()) return scene.status();
  auto next = render::FrameRenderer::create(*std::move(scene), settings, frame_,
                                            render::sequential(), renderer_.get());
  if (!next.ok()) return next.status();
  renderer_ = *std::move(next);
  return absl::OkStatus();
}

contract::FilmBlock SeededRenderer::render(const contract::PixelRect& rect,
                                           const contract::Pass& pass, std::int32_t index) const {
  return renderer_->render(rect, pass, index, render::sequential());
}

void put_tile(const server::TileSum& sum, const contract::PixelRect& rect, std::int32_t width,
              Image& image) {
  for (std::int64_t pixel = 0; pixel < sum.pixel_count(); ++pixel) {
    float rgba[4];
    sum.rgba(pixel, rgba);
    const std::int64_t x = rect.x + pixel % rect.width, y = rect.y + pixel / rect.width;
    for (std::size_t c = 0; c < 3; ++c)
      image[contract::as_index(3 * (y * width + x)) + c] = rgba[c];
  }
}

double relative_square(const Image& image, const Image& mean, const Image& variance) {
  double sum = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const double difference = image[i] - mean[i];
    sum += (difference * difference - variance[i]) / (mean[i] * mean[i] + 0.01);
  }
  return sum / static_cast<double>(image.size());
}

double mean_luminance(const Image& image) {
  double sum = 0;
  for (std::size_t i = 0; i < image.size(); i += 3) {
    sum += 0.2126 * image[i] + 0.7152 * image[i + 1] + 0.0722 * image[i + 2];
  }
  return 3 * sum / static_cast<double>(image.size());
}

FixedFrame render_fixed(const SeededRenderer& renderer, const contract::TileGrid& grid,
                        std::int32_t spp, double m) {
  const std::int32_t width = grid.window().width;
  FixedFrame frame;
  frame.image.resize(contract::as_index(std::int64_t{3} * width * grid.window().height));
  for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
    const contract::PixelRect rect = grid.rect(tile);
    server::TileSum sum(rect.width, rect.height, 0);
    std::int32_t index = 0;
    for (const contract::Pass& pass : contract::fixed_schedule(spp)) {
      sum.add(renderer.render(rect, pass, index++), pass).IgnoreError();
    }
    put_tile(sum, rect, width, frame.image);
    frame.sums.add(sum.error_sums(m));
  }
  return frame;
}

void ImageMean::add(const Image& image) {
  mean_.resize(image.size());
  squares_.resize(image.size());
  ++count_;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const double difference = image[i] - mean_[i];
    mean_[i] += difference / count_;
    squares_[i] += difference * (image[i] - mean_[i]);
  }
}

Image ImageMean::variance() const {
  Image variance = squares_;
  for (double& value : variance) value /= static_cast<double>(count_) * (count_ - 1);
  return variance;
}

}  // namespace tessera::testing
