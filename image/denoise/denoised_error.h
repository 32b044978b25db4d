#pragma once

#include <array>
#include <cstdint>

#include "image/denoise/region_errors.h"

namespace tessera::image {

/// Sums of the estimated error of denoised pixels.
struct DenoiseSums {
  std::int64_t pixels = 0;
  ErrorEstimate pixel_by_pixel;
  std::array<ErrorEstimate, kRegionSides> by_regions;  // sides of 4, 8, … pixels
  RegionSums frame;
  double magnitude = 0;  // Σ over pixels of |estimate|, and of its square
  double magnitude_squares = 0;
  std::int64_t cells = 0, raw_cells = 0;  // cells, and those that are left raw

  void add(const DenoiseSums& other);
};

/// Estimated error of a denoised image, in the measure of error-estimation.md.
struct DenoisedError {
  /// Root mean squares: the largest of all estimates, and the largest of all bounds.
  double error = 0, error_upper95 = 0;
  double n_eff = 0;  // effective number of pixels that carry the estimate of single pixels
  double raw_share = 0;
};

/// One-sided quantile of the normal distribution at 95 %.
inline constexpr double kNormalQuantile95 = 1.6448536270;
/// `quantile` is that of the normal distribution at the bound's confidence.
DenoisedError denoised_error(const DenoiseSums& sums, double quantile = kNormalQuantile95);

}  // namespace tessera::image
