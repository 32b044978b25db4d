#include "image/metrics/image_metrics.h"

#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"

namespace tessera::contract {
namespace {

std::size_t pixel_count(const ImageView& image) {
  return static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
}

absl::Status check(const ImageView& image, const char* which) {
  if (image.width < 1 || image.height < 1 || image.rgba.size() != 4 * pixel_count(image)) {
    return absl::InvalidArgumentError(absl::StrCat(which, ": ", image.rgba.size(),
                                                   " values are not ", image.width, "x",
                                                   image.height, " RGBA pixels"));
  }
  for (std::size_t i = 0; i < image.rgba.size(); ++i) {
    if (std::isfinite(image.rgba[i])) continue;
    const auto width = static_cast<std::size_t>(image.width);
    return absl::InvalidArgumentError(absl::StrCat(which, ": ", std::string(1, "RGBA"[i % 4]),
                                                   " of pixel (", i / 4 % width, ", ",
                                                   i / 4 / width, ") is not finite"));
  }
  return absl::OkStatus();
}

double mean_luminance(const ImageView& image) {
  double sum = 0;
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) {
    sum += 0.2126 * image.rgba[i] + 0.7152 * image.rgba[i + 1] + 0.0722 * image.rgba[i + 2];
  }
  return sum / static_cast<double>(pixel_count(image));
}

double srgb_encoded(double linear) {
  if (linear <= 0) return 0;
  if (linear >= 1) return 1;
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

}  // namespace

absl::StatusOr<ImageDifference> compare_images(const ImageView& image, const ImageView& reference,
                                               std::optional<double> luminance) {
  if (absl::Status status = check(image, "first image"); !status.ok()) return status;
  if (absl::Status status = check(reference, "second image"); !status.ok()) return status;
  if (image.width != reference.width || image.height != reference.height) {
    return absl::InvalidArgumentError(absl::StrCat("the images are ", image.width, "x",
                                                   image.height, " and ", reference.width, "x",
                                                   reference.height, " pixels"));
  }
  const double m = luminance.value_or(mean_luminance(reference));
  double squared = 0, relative = 0, scaled = 0, encoded = 0;
  ImageDifference result;
  for (std::size_t i = 0; i < image.rgba.size(); ++i) {
    const double x = image.rgba[i], ref = reference.rgba[i], difference = x - ref;
    if (std::fabs(difference) > result.largest) {
      result.largest = std::fabs(difference);
      const auto pixel = static_cast<std::int64_t>(i / 4);
      result.largest_x = static_cast<std::int32_t>(pixel % image.width);
      result.largest_y = static_cast<std::int32_t>(pixel / image.width);
      result.largest_channel = static_cast<std::int32_t>(i % 4);
    }
    if (i % 4 == 3 || difference == 0) continue;
    const double square = difference * difference;
    squared += square;
    relative += square / (ref * ref + 0.01);
    if (m > 0) scaled += square / (ref * ref + 0.01 * m * m);
    const double encoded_difference = srgb_encoded(x) - srgb_encoded(ref);
    encoded += encoded_difference * encoded_difference;
  }
  const double values = 3 * static_cast<double>(pixel_count(image));
  result.rmse = std::sqrt(squared / values);
  result.relmse = relative / values;
  if (m > 0) result.error = std::sqrt(scaled / values);
  if (encoded > 0) result.psnr_db = -10 * std::log10(encoded / values);
  result.flip = mean_flip(image, reference);
  return result;
}

}  // namespace tessera::contract
