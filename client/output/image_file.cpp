#include "client/output/image_file.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <span>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "image/codecs/image_codec.h"

namespace tessera::client {
namespace {

/// Images are kept as four floats per pixel: at most 4 GiB.
constexpr image::PixelLimits kLimits = {65'536, std::int64_t{4} << 30, std::int64_t{1} << 28};

absl::StatusOr<std::string> bytes_of(const std::string& path) {
  errno = 0;  // set by streams if the system reports an error, not for an empty file
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  if (!file || !(bytes << file.rdbuf())) {
    return absl::NotFoundError(
        absl::StrCat(path, ": ", errno != 0 ? std::strerror(errno) : "the file is empty"));
  }
  return std::move(bytes).str();
}

float linear_of_srgb(float encoded) {
  return encoded <= 0.04045f ? encoded / 12.92f : std::pow((encoded + 0.055f) / 1.055f, 2.4f);
}

/// Converts codes from 0 to `white`, with unassociated alpha, to linear premultiplied RGBA.
template <typename Code>
void linearise(const std::vector<Code>& codes, std::size_t channels, float white,
               std::vector<float>& rgba) {
  for (std::size_t i = 0; i < rgba.size() / 4; ++i) {
    const Code* code = &codes[i * channels];
    const float alpha = channels == 4 ? static_cast<float>(code[3]) / white : 1;
    for (std::size_t c = 0; c < 3; ++c) {
      rgba[4 * i + c] = alpha * linear_of_srgb(static_cast<float>(code[c]) / white);
    }
    rgba[4 * i + 3] = alpha;
  }
}

}  // namespace

absl::StatusOr<Image> read_image(const std::string& path) {
  const auto file = bytes_of(path);
  if (!file.ok()) return file.status();
  const auto pixels = image::decode(std::as_bytes(std::span(*file)), kLimits);
  if (!pixels.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ", std::string(pixels.status().message())));
  }
  const auto channels = static_cast<std::size_t>(pixels->channels);
  Image image{
      static_cast<std::int32_t>(pixels->width), static_cast<std::int32_t>(pixels->height), {}};
  image.rgba.assign(static_cast<std::size_t>(4 * pixels->width * pixels->height), 1.0f);
  if (!pixels->u8.empty()) linearise(pixels->u8, channels, 255, image.rgba);
  if (!pixels->u16.empty()) linearise(pixels->u16, channels, 65'535, image.rgba);
  for (std::size_t i = 0; i < pixels->f32.size(); ++i) {
    image.rgba[4 * (i / channels) + i % channels] = pixels->f32[i];
  }
  return image;
}

}  // namespace tessera::client
