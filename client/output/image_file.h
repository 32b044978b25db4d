#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "image/metrics/image_metrics.h"

namespace tessera::client {

/// An image in memory: linear RGBA, row-major from the top.
struct Image {
  std::int32_t width = 0, height = 0;
  std::vector<float> rgba;

  contract::ImageView view() const { return {width, height, rgba}; }
};

/// Reads the channels R, G, B and, if present, A of an EXR, HDR, PNG, JPEG or WebP file. Files of 8
/// and 16 bits are sRGB and converted to linear; without A, alpha is 1.
///
/// Errors: NotFound, the file does not exist, is empty or unreadable; InvalidArgument, the format
/// is not supported, the file is invalid, or it exceeds a limit.
absl::StatusOr<Image> read_image(const std::string& path);

}  // namespace tessera::client
