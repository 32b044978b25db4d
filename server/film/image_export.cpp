#include "server/film/image_export.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <vector>

#include "absl/strings/str_cat.h"
#include "image/codecs/image_codec.h"

namespace tessera::server {
namespace {

constexpr std::int64_t kBandRows = 64;

/// Returns the sRGB encoding (IEC 61966-2-1) as an 8-bit code, rounded to nearest. NaN gives 0.
std::uint8_t srgb_code(float linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 255;
  const float encoded =
      linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::lround(encoded * 255));
}

std::uint8_t linear_code(float value) {
  if (!(value > 0)) return 0;
  return value >= 1 ? std::uint8_t{255} : static_cast<std::uint8_t>(std::lround(value * 255));
}

/// Converts a pixel: `rgba` is premultiplied and linear; 4 codes for PNG, 3 for JPEG.
void encode_pixel(const float* rgba, float gain, ExportFormat format, std::uint8_t* out) {
  if (format == ExportFormat::jpeg) {  // over black, premultiplied values need no change
    for (int c = 0; c < 3; ++c) out[c] = srgb_code(rgba[c] * gain);
    return;
  }
  const float alpha = std::min(rgba[3], 1.0f);
  const float scale = alpha > 0 ? gain / alpha : gain;
  for (int c = 0; c < 3; ++c) out[c] = srgb_code(rgba[c] * scale);
  out[3] = linear_code(alpha);
}

absl::Status unreadable(const std::string& path, const std::string& reason) {
  return absl::DataLossError(absl::StrCat(path, ": ", reason));
}

/// Reads R, G, B, A of a frame's EXR file as floats, band by band.
class FrameReader {
 public:
  /// Throws OpenEXR's exceptions.
  explicit FrameReader(const std::string& path)
      : file_(path.c_str()), window_(file_.header().dataWindow()) {}

  std::int64_t width() const { return window_.max.x - window_.min.x + 1; }
  std::int64_t height() const { return window_.max.y - window_.min.y + 1; }
  bool has_rgba() const {
    const Imf::ChannelList& channels = file_.header().channels();
    for (const char* name : kNames) {
      if (channels.findChannel(name) == nullptr) return false;
    }
    return true;
  }

  /// Reads rows [begin, end), counted from 0, into `rgba`. Throws OpenEXR's exceptions.
  void read(std::int64_t begin, std::int64_t end, float* rgba) {
    const std::size_t row = 4 * sizeof(float) * static_cast<std::size_t>(width());
    const Imath::V2i origin(window_.min.x, window_.min.y + static_cast<int>(begin));
    Imf::FrameBuffer buffer;
    for (int c = 0; c < 4; ++c) {
      buffer.insert(kNames[c], Imf::Slice::Make(Imf::FLOAT, rgba + c, origin, width(), end - begin,
                                                4 * sizeof(float), row));
    }
    file_.setFrameBuffer(buffer);
    file_.readPixels(origin.y, window_.min.y + static_cast<int>(end) - 1);
  }

 private:
  static constexpr const char* kNames[] = {"R", "G", "B", "A"};
  Imf::InputFile file_;
  Imath::Box2i window_;
};

/// Reads bands, converts them and passes them to the encoder. Throws OpenEXR's exceptions.
absl::StatusOr<std::string> convert(FrameReader& frame, image::ImageEncoder& encoder,
                                    ExportFormat format, float gain) {
  const std::size_t channels = format == ExportFormat::png ? 4 : 3;
  const auto width = static_cast<std::size_t>(frame.width());
  std::vector<float> linear(4 * width * kBandRows);
  std::vector<std::uint8_t> codes(channels * width * kBandRows);
  for (std::int64_t y = 0; y < frame.height(); y += kBandRows) {
    const std::int64_t end = std::min(y + kBandRows, frame.height());
    frame.read(y, end, linear.data());
    const std::size_t pixels = width * static_cast<std::size_t>(end - y);
    for (std::size_t i = 0; i < pixels; ++i) {
      encode_pixel(&linear[4 * i], gain, format, &codes[channels * i]);
    }
    absl::Status written = encoder.write_rows(codes.data(), end - y);
    if (!written.ok()) return written;
  }
  return encoder.finish();
}

}  // namespace

absl::StatusOr<std::string> export_image(const std::string& exr_path, ExportFormat format,
                                         double exposure_ev) {
  if (::access(exr_path.c_str(), F_OK) != 0) {
    return absl::NotFoundError(absl::StrCat(exr_path, ": no such file"));
  }
  try {
    FrameReader frame(exr_path);
    if (!frame.has_rgba()) return unreadable(exr_path, "has no channels R, G, B, A");
    const auto kind =
        format == ExportFormat::png ? image::ImageFormat::png : image::ImageFormat::jpeg;
    const auto encoder = image::make_encoder(kind, frame.width(), frame.height());
    return convert(frame, *encoder, format, static_cast<float>(std::exp2(exposure_ev)));
  } catch (const std::exception& e) {  // OpenEXR's
    return unreadable(exr_path, e.what());
  }
}

}  // namespace tessera::server
