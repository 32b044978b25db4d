#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

/// Image files in memory, by libpng, libjpeg, libwebp and OpenEXR; Radiance files by OpenImageIO.
/// The last draws in some 300 libraries (a quarter of a second of CPU, more than a small job's
/// first tile), so it lives in a module of its own which the first such file opens.
namespace tessera::image {

enum class ImageFormat : std::uint8_t { unknown, png, jpeg, webp, exr, hdr, ktx2 };

/// The format of an image file, by its first bytes.
ImageFormat image_format(std::span<const std::byte> file);

/// Decoded pixels, row by row from the top, with R, G, B or R, G, B, A as the file stores them:
/// codes stay codes, alpha is not multiplied into PNG and WebP and not divided out of EXR. Grey
/// becomes R = G = B. One of the three vectors is filled.
struct Pixels {
  std::int64_t width = 0, height = 0;
  int channels = 3;  // or 4
  std::vector<std::uint8_t> u8;
  std::vector<std::uint16_t> u16;
  std::vector<float> f32;
};

/// What a file may ask for at most; checked by its header, before anything is allocated.
struct PixelLimits {
  std::int64_t side = 32'768;
  std::int64_t bytes = std::int64_t{2} << 30;  // decoded
  std::int64_t pixels = std::int64_t{1} << 30;
};

/// Writes one 8-bit image, band by band.
class ImageEncoder {
 public:
  virtual ~ImageEncoder() = default;
  /// The next `rows` rows of codes, all channels of a pixel together. Errors: Internal.
  virtual absl::Status write_rows(const std::uint8_t* codes, std::int64_t rows) = 0;
  /// The whole file, after the last row. Errors: Internal.
  virtual absl::StatusOr<std::string> finish() = 0;
};

/// Decodes a PNG, JPEG, WebP, EXR or Radiance file.
///
/// Errors: InvalidArgument for other formats, damaged files and files over `limits`; Unimplemented
/// for KTX2; FailedPrecondition, OpenImageIO's module does not lie beside the program.
absl::StatusOr<Pixels> decode(std::span<const std::byte> file, const PixelLimits& limits);

/// Begins a PNG (RGBA, not premultiplied) or JPEG (RGB) of sRGB codes.
std::unique_ptr<ImageEncoder> make_encoder(ImageFormat format, std::int64_t width,
                                           std::int64_t height);

}  // namespace tessera::image
