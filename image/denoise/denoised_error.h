#pragma once

#include <cstdint>

namespace tessera::image {

/// Sums of the estimated error of denoised pixels.
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

}  // namespace tessera::image
