#include "image/codecs/formats.h"

#include <string>

#include "absl/strings/str_cat.h"

namespace tessera::image {

absl::Status damaged(std::string_view detail) {
  std::string line(detail.substr(0, detail.find('\n')));
  for (char& c : line)
    c = c >= ' ' && c <= '~' ? c : '?';  // the message may quote bytes of the file
  return absl::InvalidArgumentError(
      absl::StrCat("the image is damaged or truncated", line.empty() ? "" : ": ", line));
}

absl::Status check_size(std::int64_t width, std::int64_t height, int channels,
                        std::size_t code_bytes, const PixelLimits& limits) {
  if (width < 1 || height < 1) return absl::InvalidArgumentError("the image has no pixels");
  const std::string size = absl::StrCat("the image is ", width, " x ", height);
  if (width > limits.side || height > limits.side) {
    return absl::InvalidArgumentError(
        absl::StrCat(size, ", more than the limit of ", limits.side, " per side"));
  }
  if (width * height > limits.pixels) {
    return absl::InvalidArgumentError(
        absl::StrCat(size, ", more than the limit of ", limits.pixels, " pixels"));
  }
  const std::int64_t bytes = width * height * channels * static_cast<std::int64_t>(code_bytes);
  if (bytes > limits.bytes) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the image takes ", bytes, " bytes decoded, more than the limit of ", limits.bytes));
  }
  if (bytes > limits.memory) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the image takes ", bytes, " bytes decoded, more than the ", limits.memory,
                     " bytes of memory that are left; use smaller images, or a machine with more "
                     "memory or a higher memory limit"));
  }
  return absl::OkStatus();
}

}  // namespace tessera::image
