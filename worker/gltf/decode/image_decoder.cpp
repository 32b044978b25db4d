#include "worker/gltf/decode/image_decoder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "image/codecs/image_codec.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {

absl::StatusOr<Image> decode_image(std::span<const std::byte> file, const std::string& name,
                                   std::uint64_t memory_bytes) {
  constexpr std::uint64_t kMax = std::numeric_limits<std::int64_t>::max();
  const auto memory = static_cast<std::int64_t>(std::min(memory_bytes, kMax));
  auto pixels =
      image::decode(file, {kMaxImageSide, kMaxImageBytes, kMaxImageSide * kMaxImageSide, memory});
  if (!pixels.ok()) return pixels.status();
  Image image;
  image.name = name;
  image.width = static_cast<std::int32_t>(pixels->width);
  image.height = static_cast<std::int32_t>(pixels->height);
  image.channels = pixels->channels;
  image.storage = !pixels->u8.empty()    ? Image::Storage::u8
                  : !pixels->u16.empty() ? Image::Storage::u16
                                         : Image::Storage::f32;
  image.u8 = std::move(pixels->u8);
  image.u16 = std::move(pixels->u16);
  image.f32 = std::move(pixels->f32);
  return image;
}

absl::StatusOr<Image> decode_environment(std::span<const std::byte> file, const std::string& name,
                                         std::uint64_t memory_bytes) {
  const image::ImageFormat format = image::image_format(file);
  if (format != image::ImageFormat::exr && format != image::ImageFormat::hdr) {
    return absl::InvalidArgumentError("not an EXR or Radiance HDR image (by its first bytes)");
  }
  auto decoded = decode_image(file, name, memory_bytes);
  if (!decoded.ok()) return decoded.status();
  Image map;
  map.name = name;
  map.width = decoded->width;
  map.height = decoded->height;
  map.channels = 3;
  map.storage = Image::Storage::f32;
  if (decoded->storage != Image::Storage::f32) {
    return absl::InvalidArgumentError("the environment map is not floating point");
  }
  const auto channels = static_cast<std::size_t>(decoded->channels);
  const std::size_t pixels = decoded->f32.size() / channels;
  std::vector<float> rgb(pixels * 3);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const float v = decoded->f32[i * channels + k];
      if (!std::isfinite(v) || v < 0) {
        return absl::InvalidArgumentError(absl::StrCat("pixel ", i % map.width, ", ", i / map.width,
                                                       " is negative or not finite"));
      }
      rgb[i * 3 + k] = v;
    }
  }
  map.f32 = std::move(rgb);
  return map;
}

}  // namespace tessera::render
