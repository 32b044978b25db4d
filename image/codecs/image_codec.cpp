#include "image/codecs/image_codec.h"

#include <dlfcn.h>

#include <cstring>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

bool begins_with(std::span<const std::byte> file, const std::string& magic, std::size_t at = 0) {
  return file.size() >= at + magic.size() &&
         std::memcmp(file.data() + at, magic.data(), magic.size()) == 0;
}

/// Path of the decoder module: beside the program in a build directory, in ../lib/tessera under any
/// installation prefix.
std::string radiance_path() {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
  const auto beside = program.parent_path() / kRadianceModule;
  if (std::filesystem::exists(beside, error)) return beside.string();
  return (program.parent_path().parent_path() / "lib/tessera" / kRadianceModule).string();
}

absl::StatusOr<RadianceDecoder> open_radiance() {
  const std::string path = radiance_path();
  // Never unloaded, because its objects need its code.
  void* module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (module == nullptr) {
    return absl::FailedPreconditionError(
        absl::StrCat("cannot load the Radiance decoder (package tessera-radiance): ", dlerror()));
  }
  using Entry = RadianceDecoder (*)();
  const auto entry = reinterpret_cast<Entry>(dlsym(module, kRadianceEntry));
  if (entry == nullptr) {
    return absl::FailedPreconditionError(absl::StrCat(path, " is not a decoder module of Tessera"));
  }
  return entry();
}

absl::StatusOr<Pixels> decode_radiance(std::span<const std::byte> file, const PixelLimits& limits) {
  static const absl::StatusOr<RadianceDecoder> decoder = open_radiance();
  return decoder.ok() ? (*decoder)(file, limits) : decoder.status();
}

}  // namespace

ImageFormat image_format(std::span<const std::byte> file) {
  if (begins_with(file, "\x89PNG\r\n\x1A\n")) return ImageFormat::png;
  if (begins_with(file, "\xFF\xD8\xFF")) return ImageFormat::jpeg;
  if (begins_with(file, "RIFF") && begins_with(file, "WEBP", 8)) return ImageFormat::webp;
  if (begins_with(file, "\x76\x2F\x31\x01")) return ImageFormat::exr;
  if (begins_with(file, "#?RADIANCE") || begins_with(file, "#?RGBE")) return ImageFormat::hdr;
  if (begins_with(file, "\xABKTX 20\xBB")) return ImageFormat::ktx2;
  return ImageFormat::unknown;
}

absl::StatusOr<Pixels> decode(std::span<const std::byte> file, const PixelLimits& limits) {
  switch (image_format(file)) {
    case ImageFormat::png:
      return decode_png(file, limits);
    case ImageFormat::jpeg:
      return decode_jpeg(file, limits);
    case ImageFormat::webp:
      return decode_webp(file, limits);
    case ImageFormat::exr:
      return decode_exr(file, limits);
    case ImageFormat::hdr:
      return decode_radiance(file, limits);
    case ImageFormat::ktx2:
      return absl::UnimplementedError("KTX2/Basis images are not supported");
    case ImageFormat::unknown:
      break;
  }
  return absl::InvalidArgumentError(
      "not a PNG, JPEG, WebP, EXR or Radiance HDR image (by its first bytes)");
}

std::unique_ptr<ImageEncoder> make_encoder(ImageFormat format, std::int64_t width,
                                           std::int64_t height) {
  return format == ImageFormat::png ? make_png_encoder(width, height)
                                    : make_jpeg_encoder(width, height);
}

}  // namespace tessera::image
