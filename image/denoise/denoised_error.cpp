#include "image/denoise/denoised_error.h"

#include <algorithm>
#include <cmath>

namespace tessera::image {

void DenoiseSums::add(const DenoiseSums& other) {
  pixels += other.pixels;
  pixel_by_pixel.add(other.pixel_by_pixel);
  for (std::size_t k = 0; k < by_regions.size(); ++k) by_regions[k].add(other.by_regions[k]);
  frame.add(other.frame);
  magnitude += other.magnitude;
  magnitude_squares += other.magnitude_squares;
  cells += other.cells;
  raw_cells += other.raw_cells;
}

DenoisedError denoised_error(const DenoiseSums& sums, double quantile) {
  DenoisedError error;
  if (sums.pixels == 0) return error;
  const double terms = 3 * static_cast<double>(sums.pixels);
  double scaled = 0, upper = 0;
  const auto consider = [&](const ErrorEstimate& estimate) {
    const double bound = estimate.scaled + quantile * std::sqrt(estimate.spread);
    if (!(estimate.scaled <= scaled)) scaled = estimate.scaled;  // keeps NaN
    if (!(bound <= upper)) upper = bound;
  };
  consider(sums.pixel_by_pixel);
  for (const ErrorEstimate& estimate : sums.by_regions) consider(estimate);
  consider(sums.frame.estimate());
  error.error = std::sqrt(scaled / terms);
  error.error_upper95 = std::sqrt(upper / terms);
  if (sums.magnitude_squares > 0) {
    error.n_eff = sums.magnitude * sums.magnitude / sums.magnitude_squares;
  }
  error.raw_share = static_cast<double>(sums.raw_cells) / static_cast<double>(sums.cells);
  return error;
}

}  // namespace tessera::image
