/// JPEG by libjpeg, whose errors return through setjmp. Objects with destructors are members of the
/// reader and the writer, because none may exist between a setjmp and the calls below it.

// libjpeg's header needs the headers before it.
// clang-format off
#include <cstdio>
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

#include <csetjmp>
#include <cstdlib>
#include <string>
#include <utility>

#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

/// libjpeg's error manager; a failure jumps to the caller's setjmp.
struct Errors {
  jpeg_error_mgr manager;  // first member: libjpeg passes a pointer to it
  std::jmp_buf out;
  char text[JMSG_LENGTH_MAX] = "";

  Errors() {
    jpeg_std_error(&manager);
    manager.error_exit = [](j_common_ptr codec) { fail(codec); };
    // Only warnings that mean missing pixels are errors; stray bytes are not.
    manager.emit_message = [](j_common_ptr codec, int level) {
      const int code = codec->err->msg_code;
      if (level < 0 && (code == JWRN_JPEG_EOF || code == JWRN_HIT_MARKER)) fail(codec);
    };
  }

  [[noreturn]] static void fail(j_common_ptr codec) {
    auto& errors = *reinterpret_cast<Errors*>(codec->err);
    codec->err->format_message(codec, errors.text);
    std::longjmp(errors.out, 1);
  }
};

/// Converts four inks, stored inverted (Adobe's convention, which readers assume even without its
/// marker): the fraction of light that each ink transmits.
std::vector<std::uint8_t> light_of_inks(const std::vector<std::uint8_t>& cmyk) {
  std::vector<std::uint8_t> rgb(cmyk.size() / 4 * 3);
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const std::size_t pixel = i / 3 * 4;
    const unsigned product = unsigned{cmyk[pixel + i % 3]} * cmyk[pixel + 3];
    rgb[i] = static_cast<std::uint8_t>((product + 127) / 255);
  }
  return rgb;
}

class JpegReader {
 public:
  explicit JpegReader(std::span<const std::byte> file) {
    jpeg_.err = &errors_.manager;
    jpeg_create_decompress(&jpeg_);
    jpeg_mem_src(&jpeg_, reinterpret_cast<const unsigned char*>(file.data()),
                 static_cast<unsigned long>(file.size()));
  }
  ~JpegReader() { jpeg_destroy_decompress(&jpeg_); }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;

  absl::StatusOr<Pixels> read(const PixelLimits& limits) {
    if (!read_header()) return damaged(errors_.text);
    Pixels image;
    image.width = jpeg_.image_width;
    image.height = jpeg_.image_height;
    const int stored = jpeg_.out_color_space == JCS_CMYK ? 4 : 3;
    absl::Status fits = check_size(image.width, image.height, stored, 1, limits);
    if (!fits.ok()) return fits;
    image.u8.resize(static_cast<std::size_t>(image.width * image.height * stored));
    codes_ = image.u8.data();
    if (!read_rows(static_cast<std::size_t>(image.width * stored))) return damaged(errors_.text);
    if (stored == 4) image.u8 = light_of_inks(image.u8);
    return image;
  }

 private:
  bool read_header() {
    if (setjmp(errors_.out) != 0) return false;
    jpeg_read_header(&jpeg_, TRUE);
    // libjpeg converts grey to RGB and YCCK to CMYK.
    jpeg_.out_color_space = jpeg_.num_components == 4 ? JCS_CMYK : JCS_RGB;
    return true;
  }

  bool read_rows(std::size_t stride) {
    if (setjmp(errors_.out) != 0) return false;
    jpeg_start_decompress(&jpeg_);
    while (jpeg_.output_scanline < jpeg_.output_height) {
      JSAMPROW row = codes_ + jpeg_.output_scanline * stride;
      jpeg_read_scanlines(&jpeg_, &row, 1);
    }
    jpeg_finish_decompress(&jpeg_);
    return true;
  }

  Errors errors_;
  jpeg_decompress_struct jpeg_{};
  JSAMPROW codes_ = nullptr;
};

class JpegEncoder final : public ImageEncoder {
 public:
  JpegEncoder(std::int64_t width, std::int64_t height)
      : stride_(static_cast<std::size_t>(width) * 3) {
    jpeg_.err = &errors_.manager;
    jpeg_create_compress(&jpeg_);
    jpeg_mem_dest(&jpeg_, &bytes_, &size_);
    jpeg_.image_width = static_cast<JDIMENSION>(width);
    jpeg_.image_height = static_cast<JDIMENSION>(height);
    good_ = start();
  }
  ~JpegEncoder() override {
    jpeg_destroy_compress(&jpeg_);
    std::free(bytes_);  // allocated by libjpeg with malloc
  }
  JpegEncoder(const JpegEncoder&) = delete;
  JpegEncoder& operator=(const JpegEncoder&) = delete;

  absl::Status write_rows(const std::uint8_t* codes, std::int64_t rows) override {
    good_ = good_ && write(codes, rows);
    return good_ ? absl::OkStatus() : absl::InternalError(errors_.text);
  }
  absl::StatusOr<std::string> finish() override {
    if (!good_ || !end()) return absl::InternalError(errors_.text);
    return std::string(reinterpret_cast<const char*>(bytes_), size_);
  }

 private:
  static constexpr int kQuality = 95;

  bool start() {
    if (setjmp(errors_.out) != 0) return false;
    jpeg_.input_components = 3;
    jpeg_.in_color_space = JCS_RGB;
    jpeg_set_defaults(&jpeg_);
    jpeg_set_quality(&jpeg_, kQuality, TRUE);
    jpeg_start_compress(&jpeg_, TRUE);
    return true;
  }
  bool write(const std::uint8_t* codes, std::int64_t rows) {
    if (setjmp(errors_.out) != 0) return false;
    for (std::int64_t y = 0; y < rows; ++y) {
      JSAMPROW row = const_cast<JSAMPROW>(codes) + static_cast<std::size_t>(y) * stride_;
      jpeg_write_scanlines(&jpeg_, &row, 1);
    }
    return true;
  }
  bool end() {
    if (setjmp(errors_.out) != 0) return false;
    jpeg_finish_compress(&jpeg_);
    return true;
  }

  const std::size_t stride_;
  Errors errors_;
  jpeg_compress_struct jpeg_{};
  unsigned char* bytes_ = nullptr;
  unsigned long size_ = 0;
  bool good_ = false;
};

}  // namespace

absl::StatusOr<Pixels> decode_jpeg(std::span<const std::byte> file, const PixelLimits& limits) {
  return JpegReader(file).read(limits);
}

std::unique_ptr<ImageEncoder> make_jpeg_encoder(std::int64_t width, std::int64_t height) {
  return std::make_unique<JpegEncoder>(width, height);
}

}  // namespace tessera::image
