/// PNG by libpng, whose errors return through setjmp. Objects with destructors are members of the
/// reader and the writer, because none may exist between a setjmp and the calls below it.

#include <png.h>

#include <csetjmp>
#include <cstring>
#include <string>
#include <utility>

#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

/// The last message of libpng.
[[noreturn]] void keep_error(png_structp png, png_const_charp message) {
  *static_cast<std::string*>(png_get_error_ptr(png)) = message;
  png_longjmp(png, 1);
}
void ignore_warning(png_structp, png_const_charp) {}

class PngReader {
 public:
  explicit PngReader(std::span<const std::byte> file)
      : rest_(file),
        png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &error_, keep_error, ignore_warning)),
        info_(png_create_info_struct(png_)) {
    png_set_read_fn(png_, this, [](png_structp png, png_bytep to, std::size_t size) {
      auto& reader = *static_cast<PngReader*>(png_get_io_ptr(png));
      if (size > reader.rest_.size()) png_error(png, "unexpected end of file");
      std::memcpy(to, reader.rest_.data(), size);
      reader.rest_ = reader.rest_.subspan(size);
    });
  }
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  absl::StatusOr<Pixels> read(const PixelLimits& limits) {
    if (!read_header()) return damaged(error_);
    Pixels image;
    image.width = png_get_image_width(png_, info_);
    image.height = png_get_image_height(png_, info_);
    image.channels = png_get_channels(png_, info_);
    const bool wide = png_get_bit_depth(png_, info_) == 16;
    const std::size_t code_bytes = wide ? 2 : 1;
    absl::Status fits = check_size(image.width, image.height, image.channels, code_bytes, limits);
    if (!fits.ok()) return fits;
    const auto row = static_cast<std::size_t>(image.width * image.channels);
    const std::size_t codes = row * static_cast<std::size_t>(image.height);
    png_bytep first = nullptr;
    if (wide) {
      image.u16.resize(codes);
      first = reinterpret_cast<png_bytep>(image.u16.data());
    } else {
      image.u8.resize(codes);
      first = image.u8.data();
    }
    rows_.resize(static_cast<std::size_t>(image.height));
    for (std::size_t y = 0; y < rows_.size(); ++y) rows_[y] = first + y * row * code_bytes;
    if (!read_rows()) return damaged(error_);
    return image;
  }

 private:
  /// Reads the header and requests R, G, B or R, G, B, A of 8 or 16 bits.
  bool read_header() {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_info(png_, info_);
    png_set_expand(png_);  // palettes, depths below 8 bits, tRNS
    png_set_gray_to_rgb(png_);
    png_set_swap(png_);  // 16 bits in the byte order of this machine
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    return true;
  }

  bool read_rows() {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_image(png_, rows_.data());
    return true;
  }

  std::span<const std::byte> rest_;
  std::string error_;
  png_structp png_;
  png_infop info_;
  std::vector<png_bytep> rows_;
};

class PngEncoder final : public ImageEncoder {
 public:
  PngEncoder(std::int64_t width, std::int64_t height)
      : stride_(static_cast<std::size_t>(width) * 4),
        png_(png_create_write_struct(PNG_LIBPNG_VER_STRING, &error_, keep_error, ignore_warning)),
        info_(png_create_info_struct(png_)) {
    png_set_write_fn(
        png_, &bytes_,
        [](png_structp png, png_bytep from, std::size_t size) {
          static_cast<std::string*>(png_get_io_ptr(png))
              ->append(reinterpret_cast<const char*>(from), size);
        },
        [](png_structp) {});
    good_ = write_header(static_cast<png_uint_32>(width), static_cast<png_uint_32>(height));
  }
  ~PngEncoder() override { png_destroy_write_struct(&png_, &info_); }
  PngEncoder(const PngEncoder&) = delete;
  PngEncoder& operator=(const PngEncoder&) = delete;

  absl::Status write_rows(const std::uint8_t* codes, std::int64_t rows) override {
    good_ = good_ && write(codes, rows);
    return good_ ? absl::OkStatus() : absl::InternalError(error_);
  }
  absl::StatusOr<std::string> finish() override {
    if (!good_ || !write_end()) return absl::InternalError(error_);
    return std::move(bytes_);
  }

 private:
  bool write_header(png_uint_32 width, png_uint_32 height) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_IHDR(png_, info_, width, height, 8, PNG_COLOR_TYPE_RGB_ALPHA, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png_, info_, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png_, info_);
    return true;
  }
  bool write(const std::uint8_t* codes, std::int64_t rows) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    for (std::int64_t y = 0; y < rows; ++y) {
      png_write_row(png_, codes + static_cast<std::size_t>(y) * stride_);
    }
    return true;
  }
  bool write_end() {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_write_end(png_, info_);
    return true;
  }

  const std::size_t stride_;
  std::string bytes_, error_;
  png_structp png_;
  png_infop info_;
  bool good_ = false;
};

}  // namespace

absl::StatusOr<Pixels> decode_png(std::span<const std::byte> file, const PixelLimits& limits) {
  return PngReader(file).read(limits);
}

std::unique_ptr<ImageEncoder> make_png_encoder(std::int64_t width, std::int64_t height) {
  return std::make_unique<PngEncoder>(width, height);
}

}  // namespace tessera::image
