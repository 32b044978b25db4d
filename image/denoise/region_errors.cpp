#include "image/denoise/region_errors.h"

#include <algorithm>
#include <cmath>

namespace tessera::image {
namespace {

/// Standard deviation of the product of two independent estimates of one value, each with the
/// variance `noise`. `product` estimates the squared value.
double product_deviation(double product, double noise) {
  return std::sqrt(noise * noise + 2 * noise * std::max(product, 0.0));
}

}  // namespace

void RegionSums::add(const RegionSums& other) {
  pixels += other.pixels;
  for (std::size_t c = 0; c < 3; ++c) {
    Channel& to = channels[c];
    const Channel& from = other.channels[c];
    for (std::size_t k = 0; k < 2; ++k) {
      to.first[k] += from.first[k];
      to.second[k] += from.second[k];
    }
    to.between += from.between;
    to.first_noise += from.first_noise;
    to.second_noise += from.second_noise;
  }
}

ErrorEstimate RegionSums::estimate() const {
  if (pixels == 0) return {};
  // The channels share samples, so their errors may be fully correlated: deviations add up.
  double scaled = 0, first_deviation = 0, second_deviation = 0;
  for (const Channel& sums : channels) {
    const double first = sums.first[0] * sums.first[1], second = sums.second[0] * sums.second[1];
    scaled += 0.5 * (first + second) - 0.25 * (sums.between * sums.between);
    first_deviation += product_deviation(first, sums.first_noise);
    second_deviation += product_deviation(second, sums.second_noise);
  }
  const auto count = static_cast<double>(pixels);
  return {scaled / count,
          0.5 * (first_deviation * first_deviation + second_deviation * second_deviation) /
              (count * count)};
}

RegionGrid::RegionGrid(std::size_t width, std::size_t height)
    : columns_((width + kLeastRegionSide - 1) / kLeastRegionSide),
      rows_((height + kLeastRegionSide - 1) / kLeastRegionSide),
      regions_(columns_ * rows_) {}

void RegionGrid::add_to(std::array<ErrorEstimate, kRegionSides>& estimates, RegionSums& whole) {
  for (ErrorEstimate& estimate : estimates) {
    for (const RegionSums& region : regions_) estimate.add(region.estimate());
    if (&estimate != &estimates.back()) double_side();
  }
  for (const RegionSums& region : regions_) whole.add(region);
}

/// Joins each 2 x 2 regions.
void RegionGrid::double_side() {
  const std::size_t columns = (columns_ + 1) / 2, rows = (rows_ + 1) / 2;
  std::vector<RegionSums> joined(columns * rows);
  for (std::size_t row = 0; row < rows_; ++row) {
    for (std::size_t column = 0; column < columns_; ++column)
      joined[row / 2 * columns + column / 2].add(regions_[row * columns_ + column]);
  }
  regions_.swap(joined);
  columns_ = columns;
  rows_ = rows;
}

}  // namespace tessera::image
