/// WebP by libwebp.

#include <webp/decode.h>

#include "image/codecs/formats.h"

namespace tessera::image {

absl::StatusOr<Pixels> decode_webp(std::span<const std::byte> file, const PixelLimits& limits) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(file.data());
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(bytes, file.size(), &features) != VP8_STATUS_OK) return damaged("");
  if (features.has_animation != 0) return damaged("animated images are not supported");
  Pixels image;
  image.width = features.width;
  image.height = features.height;
  image.channels = features.has_alpha != 0 ? 4 : 3;
  absl::Status fits = check_size(image.width, image.height, image.channels, 1, limits);
  if (!fits.ok()) return fits;
  const auto stride = static_cast<std::size_t>(image.width * image.channels);
  image.u8.resize(stride * static_cast<std::size_t>(image.height));
  const auto decode = image.channels == 4 ? WebPDecodeRGBAInto : WebPDecodeRGBInto;
  if (decode(bytes, file.size(), image.u8.data(), image.u8.size(), static_cast<int>(stride)) ==
      nullptr) {
    return damaged("");
  }
  return image;
}

}  // namespace tessera::image
