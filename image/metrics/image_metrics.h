#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "absl/status/statusor.h"

namespace tessera::contract {

/// Linear Rec. 709 pixels, R, G, B, A each, row by row from the top.
struct ImageView {
  std::int32_t width = 0, height = 0;
  std::span<const float> rgba;
};

/// Difference between an image and a reference
/// (docs/explanation/error-estimation.md#error-measure). Means are over pixels and R, G, B. For
/// display and reports only: libm makes them differ between machines, so no decision may depend on
/// them.
struct ImageDifference {
  double rmse = 0;    // root of the mean squared difference
  double relmse = 0;  // mean of (x − ref)² / (ref² + 0.01)
  /// √mean((x − ref)² / (ref² + 0.01 m²)), where m is the given luminance or the reference's; none
  /// if m <= 0.
  std::optional<double> error;
  /// Of both images clipped to [0, 1] and sRGB encoded, peak 1, decibels; none for equal images.
  std::optional<double> psnr_db;
  double flip = 0;     // mean LDR-FLIP, [0, 1]
  double largest = 0;  // largest |x − ref| over R, G, B, A, and its first position
  std::int32_t largest_x = 0, largest_y = 0, largest_channel = 0;
};

/// Compares `image` with `reference`. Errors: InvalidArgument if sizes differ, are not positive or
/// do not fit the pixels, or if a value is not finite (the message says which one).
absl::StatusOr<ImageDifference> compare_images(const ImageView& image, const ImageView& reference,
                                               std::optional<double> luminance = {});

/// Pixels per degree of visual angle for FLIP: a 0.7 m wide 4K display at 0.7 m.
inline constexpr double kFlipPixelsPerDegree = 67;

/// Mean LDR-FLIP in [0, 1] of two finite images of equal size, clipped to [0, 1]. Takes about 4 µs
/// and 200 bytes of memory per pixel.
///
/// Source: P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", HPG 2020,
/// sections 4.1 to 4.3 and table 1.
double mean_flip(const ImageView& image, const ImageView& reference);

}  // namespace tessera::contract
