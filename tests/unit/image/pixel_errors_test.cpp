// Errors of denoised pixels are relative to what is there, not to what a filter has put there.

#include "image/denoise/pixel_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>

#include "image/denoise/filter/filter_parameters.h"

namespace tessera::image {
namespace {

constexpr std::int32_t kSide = 16 + 2 * kBlurMargin;

/// A half without noise, with these values in the column x.
template <typename Denoised, typename Raw>
BlendedHalf half_of(const Denoised& denoised, const Raw& raw) {
  BlendedHalf half;
  half.width = half.height = kSide;
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::int32_t i = 0; i < kSide * kSide; ++i) {
      half.colour[c].push_back(denoised(i % kSide));
      half.raw.a[c].push_back(raw(i % kSide));
      half.raw.b[c].push_back(raw(i % kSide));
    }
  }
  half.is_raw_cell.assign(16, 0);
  return half;
}

/// Mean square of (denoised - raw) / √(reference² + floor).
double square_of(const BlendedHalf& half) {
  DenoiseSums sums;
  add_errors(half, half, sums);
  return sums.pixel_by_pixel.scaled / (3.0 * static_cast<double>(sums.pixels));
}

TEST(PixelErrors, SpreadLightIsMeasuredAgainstTheDark) {
  const double dark = 0.008, spread = 0.2;
  const BlendedHalf half = half_of([&](int) { return static_cast<float>(spread); },
                                   [&](int) { return static_cast<float>(dark); });
  const double floor = static_cast<double>(FilterParameters::kErrorFloor);
  EXPECT_NEAR(square_of(half), std::pow(spread - dark, 2) / (dark * dark + floor), 1e-5);
}

/// A pixel without a hit among others with hits is not dark.
TEST(PixelErrors, MissedPixelIsMeasuredAgainstItsArea) {
  const BlendedHalf half =
      half_of([](int) { return 1.0f; }, [](int x) { return x % 4 == 0 ? 0.0f : 4.0f / 3; });
  // The darkest mean of a missed pixel is that of two of three columns.
  const double area = 8.0 / 9, floor = static_cast<double>(FilterParameters::kErrorFloor);
  const double missed = 1 / (area * area + floor), hit = std::pow(1.0 / 3, 2) / (1 + floor);
  EXPECT_NEAR(square_of(half), 0.25 * missed + 0.75 * hit, 1e-5);
}

}  // namespace
}  // namespace tessera::image
