#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace tessera::render {

enum class ImageFormat : std::uint8_t { unknown, png, jpeg, webp, exr, hdr, ktx2 };

/// The format of an image file, by its first bytes.
ImageFormat image_format(std::span<const std::byte> file);

/// Size of an image as its header says, before anything is decoded.
struct ImageHeader {
  std::int64_t width = 0, height = 0;
  int channels = 0, bytes_per_channel = 0;
};

/// Decodes a PNG, JPEG, WebP, EXR or Radiance file. Codes are kept: 8-bit (u8), 16-bit (u16) or
/// float (f32); alpha is not multiplied in; grey becomes R = G = B; 3 or 4 channels result.
/// In WebP, colours under alpha a are only as exact as 8 bits times a (255 / a codes): the library
/// multiplies alpha in, we divide it out.
///
/// Errors: InvalidArgument for other formats, damaged files and files over the limits of
/// farm.md, section 9; Unimplemented for KTX2. Nothing is allocated before the header is checked.
absl::StatusOr<Image> decode_image(std::span<const std::byte> file, const std::string& name);

/// An EXR or Radiance file as a linear float RGB sky.
absl::StatusOr<Image> decode_environment(std::span<const std::byte> file, const std::string& name);

/// Reads the header only. Errors: as decode_image().
absl::StatusOr<ImageHeader> read_image_header(std::span<const std::byte> file);

}  // namespace tessera::render
