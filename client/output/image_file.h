#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "image/metrics/image_metrics.h"

namespace tessera::client {

/// An image in memory: linear RGBA, row by row from the top.
struct Image {
  std::int32_t width = 0, height = 0;
  std::vector<float> rgba;

  contract::ImageView view() const { return {width, height, rgba}; }
};

/// Reads the R, G, B and, where there is one, A channels of an EXR, HDR, PNG, JPEG or WebP file. 8-
/// and 16-bit files are taken as sRGB and made linear; without A, alpha is 1.
///
/// Errors: NotFound, no such file, or an empty or unreadable one; InvalidArgument, not such an
/// image, or too large (what, which limit).
absl::StatusOr<Image> read_image(const std::string& path);

}  // namespace tessera::client
