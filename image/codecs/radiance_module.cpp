/// Loadable module that reads Radiance files; no other file uses OpenImageIO.

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <exception>

#include "image/codecs/formats.h"

namespace tessera::image {
namespace {

absl::StatusOr<Pixels> decode_file(std::span<const std::byte> file, const PixelLimits& limits) {
  OIIO::Filesystem::IOMemReader bytes(const_cast<std::byte*>(file.data()), file.size());
  // Created by format name, so that no other plugin sees the bytes.
  const auto input = OIIO::ImageInput::create("hdr");
  if (input == nullptr || !input->set_ioproxy(&bytes)) {
    return absl::UnimplementedError("this OpenImageIO cannot read Radiance files from memory");
  }
  input->threads(1);  // the caller has its own
  OIIO::ImageSpec header;
  if (!input->open("memory", header)) return damaged(input->geterror());
  if (header.nchannels != 3) return damaged("its channels are not R, G, B");
  Pixels image;
  image.width = header.width;
  image.height = header.height;
  absl::Status fits = check_size(image.width, image.height, image.channels, sizeof(float), limits);
  if (!fits.ok()) return fits;
  image.f32.resize(static_cast<std::size_t>(3 * image.width * image.height));
  if (!input->read_image(0, 0, 0, 3, OIIO::TypeDesc::FLOAT, image.f32.data())) {
    return damaged(input->geterror());
  }
  return image;
}

absl::StatusOr<Pixels> decode_radiance(std::span<const std::byte> file, const PixelLimits& limits) {
  try {
    return decode_file(file, limits);
  } catch (const std::exception& e) {
    return damaged(e.what());
  }
}

}  // namespace
}  // namespace tessera::image

extern "C" tessera::image::RadianceDecoder tessera_radiance_decoder();
extern "C" tessera::image::RadianceDecoder tessera_radiance_decoder() {
  return &tessera::image::decode_radiance;
}
