#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "image/codecs/image_codec.h"

/// Decoder and encoder of each format; image_codec.h chooses among them. All check the header
/// against the limits before they allocate memory. Errors: those of decode().
namespace tessera::image {

absl::StatusOr<Pixels> decode_png(std::span<const std::byte> file, const PixelLimits& limits);
absl::StatusOr<Pixels> decode_jpeg(std::span<const std::byte> file, const PixelLimits& limits);
absl::StatusOr<Pixels> decode_webp(std::span<const std::byte> file, const PixelLimits& limits);
absl::StatusOr<Pixels> decode_exr(std::span<const std::byte> file, const PixelLimits& limits);

/// Environment maps: as R, G, B of linear Rec. 709, upright, divided by the file's exposure and
/// colour corrections.
absl::StatusOr<Pixels> decode_radiance(std::span<const std::byte> file, const PixelLimits& limits);

std::unique_ptr<ImageEncoder> make_png_encoder(std::int64_t width, std::int64_t height);
std::unique_ptr<ImageEncoder> make_jpeg_encoder(std::int64_t width, std::int64_t height);

/// InvalidArgument "the image is damaged or truncated" with the library's `detail`.
absl::Status damaged(std::string_view detail);

/// InvalidArgument if an image with `channels` codes per pixel of `code_bytes` each exceeds
/// `limits`.
absl::Status check_size(std::int64_t width, std::int64_t height, int channels,
                        std::size_t code_bytes, const PixelLimits& limits);

}  // namespace tessera::image
