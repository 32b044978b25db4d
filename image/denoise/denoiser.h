#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tessera::image {

/// Planes that denoising reads: for each of four replicates the channels of layers.h, in order.
constexpr int kDenoiseInputs = 44;
/// Side of the tiles that denoise_tile() works on; tiles are aligned to the frame's top left.
constexpr std::int32_t kDenoiseTile = 128;
/// Pixels around a tile on which its result depends.
constexpr std::int32_t kDenoiseMargin = 28;
/// Side of the squares for which the filter is chosen.
constexpr std::int32_t kDenoiseCell = 4;

/// Rows of a frame: planes of `rows` rows of `width` values, row by row from the top. All values
/// must be finite.
struct DenoiseRows {
  std::int32_t width = 0, height = 0;  // of the frame
  std::int32_t first_row = 0, rows = 0;
  std::array<const float*, kDenoiseInputs> planes{};
  /// The frame's mean luminance m > 0, the unit of the filter's tolerances.
  double mean_luminance = 1;
};

/// Sums of the estimated error of denoised pixels. Fold tiles in order, row by row from the top.
struct DenoiseSums {
  std::int64_t pixels = 0;
  double scaled = 0;     // Σ over pixels and channels of the squared error ÷ (d² + 0.01 m²)
  double spread = 0;     // bound of the variance of `scaled`, given the denoised halves
  double magnitude = 0;  // Σ over pixels of |estimate|, and of its square
  double magnitude_squares = 0;
  std::int64_t cells = 0, raw_cells = 0;  // cells, and those that are left raw

  void add(const DenoiseSums& other);
};

/// Estimated error of a denoised image, in the measure of error-estimation.md.
struct DenoisedError {
  double error = 0, error_upper95 = 0;
  double n_eff = 0;  // effective number of pixels that carry the estimate
  double raw_share = 0;
};

/// One-sided quantile of the normal distribution at 95 %.
inline constexpr double kNormalQuantile95 = 1.6448536270;
/// `quantile` is that of the normal distribution at the bound's confidence.
DenoisedError denoised_error(const DenoiseSums& sums, double quantile = kNormalQuantile95);

/// A denoised tile: R, G, B, row by row from the top, in the frame's unit.
struct DenoisedTile {
  std::int32_t width = 0, height = 0;
  std::array<std::vector<float>, 3> rgb;
  /// Whether the pixel is the mean of the replicates.
  std::vector<std::uint8_t> is_raw;
  DenoiseSums sums;
};

/// Denoises the tile whose top left pixel is (x, y). `rows` must contain all rows of the frame
/// within kDenoiseMargin of the tile.
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
/// A pure function: only + − × ÷ √ in a fixed order, so that the bits are the same everywhere.
DenoisedTile denoise_tile(const DenoiseRows& rows, std::int32_t x, std::int32_t y);

}  // namespace tessera::image
