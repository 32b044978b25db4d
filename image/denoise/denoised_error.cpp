#include "image/denoise/denoised_error.h"

#include <algorithm>
#include <cmath>

namespace tessera::image {

void DenoiseSums::add(const DenoiseSums& other) {
  pixels += other.pixels;
  scaled += other.scaled;
  spread += other.spread;
  magnitude += other.magnitude;
  magnitude_squares += other.magnitude_squares;
  cells += other.cells;
  raw_cells += other.raw_cells;
}

DenoisedError denoised_error(const DenoiseSums& sums, double quantile) {
  DenoisedError error;
  if (sums.pixels == 0) return error;
  const double terms = 3 * static_cast<double>(sums.pixels);
  const double upper = sums.scaled + quantile * std::sqrt(sums.spread);
  error.error = std::sqrt(std::max(sums.scaled, 0.0) / terms);
  error.error_upper95 = std::sqrt(std::max(upper, 0.0) / terms);
  if (sums.magnitude_squares > 0) {
    error.n_eff = sums.magnitude * sums.magnitude / sums.magnitude_squares;
  }
  error.raw_share = static_cast<double>(sums.raw_cells) / static_cast<double>(sums.cells);
  return error;
}

}  // namespace tessera::image
