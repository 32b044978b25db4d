#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/stopping/error_estimate.h"
#include "contract/tile_grid.h"
#include "server/film/merge.h"
#include "tests/support/scene/folder_reader.h"
#include "worker/gltf/build/loader.h"
#include "worker/render/frame_renderer.h"

namespace tessera::testing {

/// R, G, B of a frame, row by row, in double.
using Image = std::vector<double>;

/// Renders a scene with one seed after another; what seeds share is built once.
class SeededRenderer {
 public:
  SeededRenderer(std::string scene, contract::RenderSettings settings)
      : scene_(std::move(scene)), settings_(std::move(settings)) {}

  /// Errors: those of the loader and of FrameRenderer::create.
  absl::Status load();
  absl::Status use_seed(std::uint32_t seed);
  /// The frame of later seeds; 0 at first.
  void set_frame(std::int32_t frame) { frame_ = frame; }
  contract::FilmBlock render(const contract::PixelRect& rect, const contract::Pass& pass,
                             std::int32_t index) const;

 private:
  std::string scene_;
  contract::RenderSettings settings_;
  std::int32_t frame_ = 0;
  std::unique_ptr<FolderReader> reader_;
  std::unique_ptr<render::SceneFile> file_;
  std::unique_ptr<render::FrameRenderer> renderer_;
};

/// Writes a tile's means to its position in an image of `width` pixels a row.
void put_tile(const server::TileSum& sum, const contract::PixelRect& rect, std::int32_t width,
              Image& image);

double mean_luminance(const Image& image);

/// Mean over pixels and channels of the squared error divided by mean² + 0.01, less the variance of
/// the reference, whose mean and variance are given.
double relative_square(const Image& image, const Image& mean, const Image& variance);

/// A frame of a fixed sample count, and its own error estimate with mean `m` (0: none).
struct FixedFrame {
  Image image;
  contract::ErrorSums sums;
};
FixedFrame render_fixed(const SeededRenderer& renderer, const contract::TileGrid& grid,
                        std::int32_t spp, double m);

/// Mean over frames of independent seeds and the variance of that mean, per pixel and channel.
class ImageMean {
 public:
  void add(const Image& image);
  const Image& mean() const { return mean_; }
  Image variance() const;

 private:
  int count_ = 0;
  Image mean_, squares_;  // squares: sum of squared distances from the mean (Welford 1962)
};

}  // namespace tessera::testing
