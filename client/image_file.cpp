#include "client/image_file.h"

#include <OpenImageIO/imageio.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "absl/strings/str_cat.h"

namespace tessera::client {
namespace {

constexpr std::int64_t kMaxPixels = std::int64_t{1} << 28;

/// Name of the format by the file's first bytes; empty if it is none of those we open.
/// OpenImageIO would open many more, through libraries we have no use for.
std::string format_by_magic(const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             &std::fclose);
  if (file == nullptr) return "";
  char start[10] = {};
  if (std::fread(start, 1, sizeof start, file.get()) == 0) return "";
  const auto begins = [&start](const char* magic, std::size_t size) {
    return std::memcmp(start, magic, size) == 0;
  };
  if (begins("\x76\x2f\x31\x01", 4)) return "openexr";
  if (begins("\x89PNG\r\n\x1a\n", 8)) return "png";
  if (begins("\xff\xd8\xff", 3)) return "jpeg";
  if (begins("#?RADIANCE", 10) || begins("#?RGBE", 6)) return "hdr";
  return "";
}

absl::Status bad(const std::string& path, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": ", what));
}

float linear_of_srgb(float encoded) {
  return encoded <= 0.04045f ? encoded / 12.92f : std::pow((encoded + 0.055f) / 1.055f, 2.4f);
}

}  // namespace

absl::StatusOr<Image> read_image(const std::string& path) {
  if (::access(path.c_str(), R_OK) != 0) {
    return absl::NotFoundError(absl::StrCat(path, ": ", std::strerror(errno)));
  }
  const std::string format = format_by_magic(path);
  if (format.empty()) return bad(path, "not an EXR, HDR, PNG or JPEG image");
  const std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::create(format);
  OIIO::ImageSpec spec;
  OIIO::ImageSpec hints;
  hints.attribute("oiio:UnassociatedAlpha", 0);
  if (input == nullptr || !input->open(path, spec, hints)) {
    return bad(path, input == nullptr ? OIIO::geterror() : input->geterror());
  }
  const std::int64_t pixels = std::int64_t{spec.width} * spec.height;
  if (pixels < 1 || pixels > kMaxPixels) {
    return bad(path, absl::StrCat(spec.width, "x", spec.height, " pixels, at most ", kMaxPixels));
  }
  Image image{spec.width, spec.height, {}};
  image.rgba.assign(static_cast<std::size_t>(4 * pixels), 1.0f);
  static constexpr const char* kNames[] = {"R", "G", "B", "A"};
  const bool grey = spec.channelindex("Y") >= 0 && spec.channelindex("R") < 0;
  for (std::size_t c = 0; c < 4; ++c) {
    const int channel = spec.channelindex(grey && c < 3 ? "Y" : kNames[c]);
    if (channel < 0 && c == 3) continue;
    if (channel < 0) return bad(path, absl::StrCat("has no channel ", kNames[c]));
    if (!input->read_image(0, 0, channel, channel + 1, OIIO::TypeDesc::FLOAT, &image.rgba[c],
                           4 * sizeof(float))) {
      return bad(path, input->geterror());
    }
  }
  if (format == "png" || format == "jpeg") {
    for (std::size_t i = 0; i < image.rgba.size(); ++i) {
      if (i % 4 != 3) image.rgba[i] = linear_of_srgb(image.rgba[i]);
    }
  }
  return image;
}

}  // namespace tessera::client
