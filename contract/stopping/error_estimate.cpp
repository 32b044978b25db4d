#include "contract/stopping/error_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "contract/version.h"

namespace tessera::contract {
namespace {

constexpr double kChannels = 3;
/// Keeps the bound finite where the error is that of one or two pixels.
constexpr double kLeastShrinking = 1.0 / 64;

/// Quantiles of the normal distribution at 1 − 0.05/k, k = 1, 2, … (a table: decisions must have
/// the same bits everywhere).
constexpr std::array kQuantiles = {
    1.6448536270, 1.9599639845, 2.1280452342, 2.2414027276, 2.3263478740, 2.3939797998,
    2.4499976606, 2.4977054744, 2.5391848137, 2.5758293035, 2.6086163874, 2.6382572735,
    2.6652851060, 2.6901095272, 2.7130518885, 2.7343687865, 2.7542682706, 2.7729212946,
    2.7904699911, 2.8070337683, 2.8227138814, 2.8375969129, 2.8517574606, 2.8652602385,
    2.8781617391, 2.8905115607, 2.9023534789, 2.9137263183, 2.9246646672, 2.9351994689,
    2.9453585129, 2.9551668475};

}  // namespace

void ErrorSums::add(const ErrorSums& other) {
  pixels += other.pixels;
  squared += other.squared;
  relative += other.relative;
  scaled += other.scaled;
  cautious += other.cautious;
  cautious_squares += other.cautious_squares;
}

ErrorSums ErrorSums::without(const ErrorSums& part) const {
  return {pixels - part.pixels, squared - part.squared,   relative - part.relative,
          scaled - part.scaled, cautious - part.cautious, cautious_squares - part.cautious_squares};
}

ErrorSums ErrorSums::scaled_by(double factor) const {
  return {pixels,          squared * factor,  relative * factor,
          scaled * factor, cautious * factor, cautious_squares * factor * factor};
}

double mean_scaled(const ErrorSums& sums) {
  return sums.scaled / (kChannels * static_cast<double>(sums.pixels));
}

double mean_cautious(const ErrorSums& sums) {
  return sums.cautious / (kChannels * static_cast<double>(sums.pixels));
}

double look_quantile(int looks) {
  const int row = std::clamp(looks, 1, static_cast<int>(kQuantiles.size())) - 1;
  return kQuantiles[static_cast<std::size_t>(row)];
}

double upper_mean(const ErrorSums& sums, int looks) {
  const auto pixels = static_cast<double>(sums.pixels);
  const double mean = mean_cautious(sums);
  double standard_error = mean;  // the spread is unknown with a single pixel
  if (sums.pixels > 1) {
    const double per_pixel = sums.cautious / pixels;
    const double spread = sums.cautious_squares / pixels - per_pixel * per_pixel;
    standard_error = spread > 0 ? std::sqrt(spread / (pixels - 1)) / kChannels : 0;
  }
  if (mean == 0) return 0;
  const double deviation = look_quantile(looks) * standard_error / mean;
  const double shrunk = std::max(1 - deviation / 2, kLeastShrinking);
  const double root = std::sqrt(static_cast<double>(kReplicates));
  return mean * (1 + root * deviation / shrunk);
}

double effective_pixels(const ErrorSums& sums) {
  return sums.cautious_squares > 0 ? sums.cautious * sums.cautious / sums.cautious_squares : 0;
}

ErrorEstimate estimate_error(const ErrorSums& sums, int looks) {
  ErrorEstimate estimate;
  estimate.pixels = sums.pixels;
  if (sums.pixels == 0) return estimate;
  const double terms = kChannels * static_cast<double>(sums.pixels);
  estimate.rmse = std::sqrt(sums.squared / terms);
  estimate.relmse = sums.relative / terms;
  estimate.error = std::sqrt(mean_scaled(sums));
  estimate.error_upper95 = std::sqrt(upper_mean(sums, looks));
  estimate.n_eff = effective_pixels(sums);
  return estimate;
}

}  // namespace tessera::contract
