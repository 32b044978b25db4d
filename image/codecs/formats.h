#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "image/codecs/image_codec.h"

/// One pair of functions a format; image_codec.h chooses among them. All check the header against
/// the limits before anything is allocated. Errors: those of decode().
namespace tessera::image {

absl::StatusOr<Pixels> decode_png(std::span<const std::byte> file, const PixelLimits& limits);
absl::StatusOr<Pixels> decode_jpeg(std::span<const std::byte> file, const PixelLimits& limits);
absl::StatusOr<Pixels> decode_webp(std::span<const std::byte> file, const PixelLimits& limits);
absl::StatusOr<Pixels> decode_exr(std::span<const std::byte> file, const PixelLimits& limits);

/// How OpenImageIO's module is called: it exports a function of this type.
using RadianceDecoder = absl::StatusOr<Pixels> (*)(std::span<const std::byte> file,
                                                   const PixelLimits& limits);
inline constexpr const char* kRadianceModule = "tessera_radiance.so";
inline constexpr const char* kRadianceEntry = "tessera_radiance_decoder";

std::unique_ptr<ImageEncoder> make_png_encoder(std::int64_t width, std::int64_t height);
std::unique_ptr<ImageEncoder> make_jpeg_encoder(std::int64_t width, std::int64_t height);

/// "the image is damaged or truncated", with what the library says of it.
absl::Status damaged(std::string_view detail);

/// InvalidArgument if an image of that many codes a pixel, of `code_bytes` each, is over `limits`.
absl::Status check_size(std::int64_t width, std::int64_t height, int channels,
                        std::size_t code_bytes, const PixelLimits& limits);

}  // namespace tessera::image
