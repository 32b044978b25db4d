#include "image/denoise/denoiser.h"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <utility>

#include "image/denoise/frames/frame_input.h"
#include "image/denoise/frames/parallel.h"
#include "image/denoise/half_denoiser.h"
#include "image/denoise/pixel_errors.h"

namespace tessera::image {
using contract::PixelRect;

class Denoiser::State {
 public:
  State(const DenoiseFrame& frame, const PixelRect& window, int threads,
        const AnimationInput* animation)
      : frame_(frame),
        window_(window),
        threads_(threads),
        has_guide_(animation != nullptr),
        tiles_((window.width + kDenoiseTile - 1) / kDenoiseTile),
        next_row_(window.y),
        halves_{HalfDenoiser(0, frame, window, animation),
                HalfDenoiser(1, frame, window, animation)},
        tile_sums_(static_cast<std::size_t>(tiles_)) {}

  std::int32_t input_begin() const {
    return std::max(0, next_row_ - (next_row_ == window_.y ? kDenoiseMargin : kBlurMargin));
  }
  std::int32_t input_end() const { return std::min(frame_.height, band_end() + kDenoiseMargin); }
  const DenoiseSums& sums() const { return sums_; }

  DenoisedRows next(const DenoiseRows& rows) {
    const FrameInput input(frame_, rows);
    const std::int32_t end = band_end();
    for (HalfDenoiser& half : halves_) half.extend(end);
    if (!has_guide_) {
      run_stage(kGuideStage,
                [&](HalfDenoiser& half, const PixelRect& part) { half.add_guide(input, part); });
    }
    run_stage(kCandidateStage,
              [&](HalfDenoiser& half, const PixelRect& part) { half.add_candidates(input, part); });
    DenoisedRows result = blended_rows(input);
    for (HalfDenoiser& half : halves_) half.drop(end);
    next_row_ = end;
    if ((end - window_.y) % kDenoiseTile == 0 || end == window_.y + window_.height) {
      for (DenoiseSums& sums : tile_sums_) sums_.add(std::exchange(sums, {}));
    }
    return result;
  }

 private:
  std::int32_t band_end() const {
    return std::min(next_row_ + kDenoiseBand, window_.y + window_.height);
  }

  /// Computes what the next band needs of a stage and former bands did not.
  void run_stage(const FilterStage& stage,
                 const std::function<void(HalfDenoiser&, const PixelRect&)>& work) {
    const std::int32_t top = next_row_ == window_.y
                                 ? std::max(window_.y - stage.reach, -stage.beyond)
                                 : halves_[0].stage_end(stage, next_row_);
    const std::int32_t bottom = halves_[0].stage_end(stage, band_end());
    for_all(2 * tiles_, threads_, [&](std::int32_t i) {
      const std::int32_t tile = i / 2, left = stage_left(stage, tile),
                         right = stage_left(stage, tile + 1);
      if (left == right || top == bottom) return;
      work(halves_[i % 2], {left, top, right - left, bottom - top});
    });
  }

  /// Left end of the pixels of a stage that a tile needs and the tile to its left does not.
  std::int32_t stage_left(const FilterStage& stage, std::int32_t tile) const {
    if (tile == 0) return std::max(window_.x - stage.reach, -stage.beyond);
    return std::min(
        std::min(window_.x + tile * kDenoiseTile, window_.x + window_.width) + stage.reach,
        frame_.width + stage.beyond);
  }

  DenoisedRows blended_rows(const FrameInput& input) {
    DenoisedRows result;
    result.rows = band_end() - next_row_;
    const std::size_t pixels =
        static_cast<std::size_t>(result.rows) * static_cast<std::size_t>(window_.width);
    for (std::vector<float>& plane : result.rgb) plane.resize(pixels);
    result.is_raw.resize(pixels);
    for_all(tiles_, threads_, [&](std::int32_t tile) {
      const std::int32_t left = tile * kDenoiseTile,
                         width = std::min(kDenoiseTile, window_.width - left);
      const PixelRect part{window_.x + left, next_row_, width, result.rows};
      const BlendedHalf first = halves_[0].blend(input, part),
                        second = halves_[1].blend(input, part);
      add_errors(first, second, tile_sums_[static_cast<std::size_t>(tile)]);
      put_part(first, second, static_cast<std::size_t>(left), result);
    });
    return result;
  }

  /// Copies the mean of both halves into the columns from `left` on.
  void put_part(const BlendedHalf& first, const BlendedHalf& second, std::size_t left,
                DenoisedRows& result) const {
    const auto scale = static_cast<float>(frame_.mean_luminance);
    const auto width = static_cast<std::size_t>(first.width),
               rows = static_cast<std::size_t>(result.rows);
    for (std::size_t row = 0; row < rows; ++row) {
      std::size_t i = (row + kBlurMargin) * width + kBlurMargin;
      std::size_t to = row * static_cast<std::size_t>(window_.width) + left;
      for (std::size_t x = 0; x < width - 2 * std::size_t{kBlurMargin}; ++x, ++i, ++to) {
        for (std::size_t c = 0; c < 3; ++c)
          result.rgb[c][to] = 0.5f * (first.colour[c][i] + second.colour[c][i]) * scale;
        result.is_raw[to] = first.is_raw[i] & second.is_raw[i];
      }
    }
  }

  const DenoiseFrame frame_;
  const PixelRect window_;
  const int threads_;
  const bool has_guide_;
  const std::int32_t tiles_;  // columns of tiles
  std::int32_t next_row_;
  HalfDenoiser halves_[2];
  std::vector<DenoiseSums> tile_sums_;  // of the current row of tiles
  DenoiseSums sums_;
};

Denoiser::Denoiser(const DenoiseFrame& frame, const PixelRect& window, int threads,
                   const AnimationInput* animation)
    : state_(std::make_unique<State>(frame, window, threads, animation)) {}

Denoiser::~Denoiser() = default;
Denoiser::Denoiser(Denoiser&&) noexcept = default;

std::int32_t Denoiser::input_begin() const {
  return state_->input_begin();
}

std::int32_t Denoiser::input_end() const {
  return state_->input_end();
}

DenoisedRows Denoiser::next(const DenoiseRows& input) {
  return state_->next(input);
}

const DenoiseSums& Denoiser::sums() const {
  return state_->sums();
}

}  // namespace tessera::image
