#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "contract/render_settings.h"
#include "image/denoise/denoised_error.h"
#include "image/denoise/frames/frame_fusion.h"
#include "image/denoise/frames/frame_input.h"

namespace tessera::image {

/// Rows that are denoised together.
constexpr std::int32_t kDenoiseBand = 64;
/// Side of the tiles whose errors are summed; tiles are aligned to the frame's top left.
constexpr std::int32_t kDenoiseTile = 128;
/// Pixels around a denoised one on which its value depends.
constexpr std::int32_t kDenoiseMargin = 32;

/// Denoised rows: R, G, B, row by row from the top, in the frame's unit.
struct DenoisedRows {
  std::int32_t rows = 0;
  std::array<std::vector<float>, 3> rgb;
  /// Whether the pixel is the mean of the replicates.
  std::vector<std::uint8_t> is_raw;
};

/// Denoises a window of a frame in bands of rows from the top.
///
/// The replicates form two halves. Each half is filtered with its own samples only, and its filter
/// is chosen by them; the result is the mean of both. So the samples of one half measure the error
/// of the other without bias. The squared error (d − μ)² of d, the mean of the halves d₁ and d₂, is
/// the mean of their squared errors minus (d₁ − d₂)²/4.
///
/// A half is filtered three times. NL-means with small windows (Rousselle et al. 2012, 2013) over
/// colour and features gives a guide. Its distances weight a zero-order filter, and a first-order
/// regression on the features (Bitterli et al. 2016). Per cell, the filter with the least
/// cross-validated error is chosen among both and the raw image.
///
/// Uses only + − × ÷ √ in a fixed order, so that the bits are the same everywhere. They do not
/// depend on the window or the threads either.
class Denoiser {
 public:
  /// The window is part of the frame. Its left and top are multiples of kDenoiseTile, and so are
  /// its right and bottom unless they are the frame's.
  /// With `animation`, the neighbours of the frame count too; it may be null.
  Denoiser(const DenoiseFrame& frame, const contract::PixelRect& window, int threads,
           const AnimationInput* animation = nullptr);
  ~Denoiser();
  Denoiser(Denoiser&&) noexcept;
  Denoiser(const Denoiser&) = delete;
  Denoiser& operator=(const Denoiser&) = delete;

  /// Rows [input_begin(), input_end()) of the frame are what next() reads.
  std::int32_t input_begin() const;
  std::int32_t input_end() const;
  /// Denoises the next kDenoiseBand rows, or fewer if the window ends before.
  DenoisedRows next(const DenoiseRows& input);
  /// Sums of the tiles finished so far: tile after tile, row by row from the top.
  const DenoiseSums& sums() const;

 private:
  class State;
  std::unique_ptr<State> state_;
};

}  // namespace tessera::image
