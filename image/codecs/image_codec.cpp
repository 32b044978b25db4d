#include "image/codecs/image_codec.h"

#include <cstring>

#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

bool begins_with(std::span<const std::byte> file, const std::string& magic, std::size_t at = 0) {
  return file.size() >= at + magic.size() &&
         std::memcmp(file.data() + at, magic.data(), magic.size()) == 0;
}

}  // namespace

ImageFormat image_format(std::span<const std::byte> file) {
  if (begins_with(file, "\x89PNG\r\n\x1A\n")) return ImageFormat::png;
  if (begins_with(file, "\xFF\xD8\xFF")) return ImageFormat::jpeg;
  if (begins_with(file, "RIFF") && begins_with(file, "WEBP", 8)) return ImageFormat::webp;
  if (begins_with(file, "\x76\x2F\x31\x01")) return ImageFormat::exr;
  if (begins_with(file, "#?")) return ImageFormat::hdr;  // the program's name follows
  if (begins_with(file, "\xABKTX 20\xBB")) return ImageFormat::ktx2;
  return ImageFormat::unknown;
}

absl::StatusOr<Pixels> decode(std::span<const std::byte> file, const PixelLimits& limits) {
  switch (image_format(file)) {
    case ImageFormat::png:
      return decode_png(file, limits);
    case ImageFormat::jpeg:
      return decode_jpeg(file, limits);
    case ImageFormat::webp:
      return decode_webp(file, limits);
    case ImageFormat::exr:
      return decode_exr(file, limits);
    case ImageFormat::hdr:
      return decode_radiance(file, limits);
    case ImageFormat::ktx2:
      return absl::UnimplementedError("KTX2/Basis images are not supported");
    case ImageFormat::unknown:
      break;
  }
  return absl::InvalidArgumentError(
      "not a PNG, JPEG, WebP, EXR or Radiance HDR image (by its first bytes)");
}

std::unique_ptr<ImageEncoder> make_encoder(ImageFormat format, std::int64_t width,
                                           std::int64_t height) {
  return format == ImageFormat::png ? make_png_encoder(width, height)
                                    : make_jpeg_encoder(width, height);
}

}  // namespace tessera::image
