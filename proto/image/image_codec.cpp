#include "proto/image/image_codec.h"

#include <dlfcn.h>

#include <cstring>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace tessera::image {
namespace {

bool begins_with(std::span<const std::byte> file, const std::string& magic, std::size_t at = 0) {
  return file.size() >= at + magic.size() &&
         std::memcmp(file.data() + at, magic.data(), magic.size()) == 0;
}

/// The module lies beside the program: build folders, packages and images all keep it there.
absl::StatusOr<const ImageCodec*> open_module() {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string path = (program.parent_path() / "tessera_image_codec.so").string();
  // Kept until the process ends: its objects and their code must not part.
  void* module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (module == nullptr) {
    return absl::FailedPreconditionError(absl::StrCat("cannot open the image codec: ", dlerror()));
  }
  using Entry = const ImageCodec* (*)();
  const auto entry = reinterpret_cast<Entry>(dlsym(module, "tessera_image_codec"));
  if (entry == nullptr) {
    return absl::FailedPreconditionError(absl::StrCat(path, " is not Tessera's image codec"));
  }
  return entry();
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

absl::StatusOr<const ImageCodec*> ImageCodec::open() {
  static const absl::StatusOr<const ImageCodec*> codec = open_module();
  return codec;
}

}  // namespace tessera::image
