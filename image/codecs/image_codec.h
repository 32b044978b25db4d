#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

/// Image files in memory, by libpng, libjpeg, libwebp and OpenEXR; Radiance files by our own
/// reader.
namespace tessera::image {

enum class ImageFormat : std::uint8_t { unknown, png, jpeg, webp, exr, hdr, ktx2 };

/// Format of an image file, by its first bytes.
ImageFormat image_format(std::span<const std::byte> file);

/// Decoded pixels, row by row from the top, as R, G, B or R, G, B, A. Codes are kept as stored;
/// alpha is straight for PNG and WebP and premultiplied for EXR. Grey becomes R = G = B. One of the
/// three vectors is filled.
struct Pixels {
  std::int64_t width = 0, height = 0;
  int channels = 3;  // or 4
  std::vector<std::uint8_t> u8;
  std::vector<std::uint16_t> u16;
  std::vector<float> f32;
};

/// Limits of an image file, checked on its header before memory is allocated.
struct PixelLimits {
  std::int64_t side = 32'768;
  std::int64_t bytes = std::int64_t{2} << 30;  // decoded
  std::int64_t pixels = std::int64_t{1} << 30;
  std::int64_t memory = std::numeric_limits<std::int64_t>::max();  // bytes that are left
};

/// Writes an 8-bit image in bands of rows.
class ImageEncoder {
 public:
  virtual ~ImageEncoder() = default;
  /// Appends `rows` rows of interleaved codes. Errors: Internal.
  virtual absl::Status write_rows(const std::uint8_t* codes, std::int64_t rows) = 0;
  /// Returns the whole file after the last row. Errors: Internal.
  virtual absl::StatusOr<std::string> finish() = 0;
};

/// Decodes a PNG, JPEG, WebP, EXR or Radiance file.
///
/// Errors: InvalidArgument for other formats, damaged files and files over `limits`;
/// ResourceExhausted if only the memory does not suffice; Unimplemented for KTX2.
absl::StatusOr<Pixels> decode(std::span<const std::byte> file, const PixelLimits& limits);

/// Creates an encoder for a PNG (RGBA, not premultiplied) or JPEG (RGB) of sRGB codes.
std::unique_ptr<ImageEncoder> make_encoder(ImageFormat format, std::int64_t width,
                                           std::int64_t height);

}  // namespace tessera::image
