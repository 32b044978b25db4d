#include "server/film/image_export.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr int kBandRows = 64;

/// sRGB's curve (IEC 61966-2-1) as an 8-bit code, rounded to nearest. NaN gives 0.
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

/// One pixel: `rgba` premultiplied and linear; 4 codes for PNG, 3 for JPEG.
void encode_pixel(const float* rgba, float gain, ExportFormat format, std::uint8_t* out) {
  if (format == ExportFormat::jpeg) {  // premultiplied over black is what it is
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

/// Opens an EXR whose first four channels are R, G, B, A, as OpenImageIO orders them.
absl::StatusOr<std::unique_ptr<OIIO::ImageInput>> open_frame(const std::string& path) {
  if (!OIIO::Filesystem::exists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::open(path);
  if (input == nullptr) return unreadable(path, OIIO::geterror());
  const std::vector<std::string>& names = input->spec().channelnames;
  if (names.size() < 4 || names[0] != "R" || names[1] != "G" || names[2] != "B" ||
      names[3] != "A") {
    return unreadable(path, "its first channels are not R, G, B, A");
  }
  return input;
}

/// Reads bands, converts them, and hands them to the encoder.
absl::Status convert(OIIO::ImageInput& input, OIIO::ImageOutput& output, ExportFormat format,
                     float gain) {
  const OIIO::ImageSpec& spec = input.spec();
  const std::size_t channels = format == ExportFormat::png ? 4 : 3;
  const auto width = static_cast<std::size_t>(spec.width);
  std::vector<float> linear(4 * width * kBandRows);
  std::vector<std::uint8_t> codes(channels * width * kBandRows);
  for (int y = 0; y < spec.height; y += kBandRows) {
    const int end = std::min(y + kBandRows, spec.height);
    if (!input.read_scanlines(0, 0, spec.y + y, spec.y + end, 0, 0, 4, OIIO::TypeDesc::FLOAT,
                              linear.data())) {
      return absl::DataLossError(input.geterror());
    }
    const std::size_t pixels = width * static_cast<std::size_t>(end - y);
    for (std::size_t i = 0; i < pixels; ++i) {
      encode_pixel(&linear[4 * i], gain, format, &codes[channels * i]);
    }
    if (!output.write_scanlines(y, end, 0, OIIO::TypeDesc::UINT8, codes.data())) {
      return absl::InternalError(output.geterror());
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::string> export_image(const std::string& exr_path, ExportFormat format,
                                         double exposure_ev) {
  absl::StatusOr<std::unique_ptr<OIIO::ImageInput>> input = open_frame(exr_path);
  if (!input.ok()) return input.status();
  const bool png = format == ExportFormat::png;
  OIIO::ImageSpec spec((*input)->spec().width, (*input)->spec().height, png ? 4 : 3,
                       OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:ColorSpace", "sRGB");
  if (png) spec.attribute("oiio:UnassociatedAlpha", 1);  // already divided by alpha here
  if (!png) spec.attribute("Compression", "jpeg:95");
  const char* name = png ? "frame.png" : "frame.jpg";
  const std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create(name);
  if (output == nullptr) return absl::InternalError(OIIO::geterror());
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput memory(bytes);
  if (!output->set_ioproxy(&memory) || !output->open(name, spec)) {
    return absl::InternalError(output->geterror());
  }
  const auto gain = static_cast<float>(std::exp2(exposure_ev));
  absl::Status status = convert(**input, *output, format, gain);
  if (!output->close() && status.ok()) status = absl::InternalError(output->geterror());
  if (!status.ok()) return status;
  return std::string(bytes.begin(), bytes.end());
}

}  // namespace tessera::server
