/// The module that ImageCodec::open() opens; the only file of the product that knows OpenImageIO.

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <exception>

#include "absl/strings/str_cat.h"
#include "proto/image/image_codec.h"

namespace tessera::image {
namespace {

const char* plugin_name(ImageFormat format) {
  switch (format) {
    case ImageFormat::png:
      return "png";
    case ImageFormat::jpeg:
      return "jpeg";
    case ImageFormat::webp:
      return "webp";
    case ImageFormat::exr:
      return "openexr";
    case ImageFormat::hdr:
      return "hdr";
    default:
      return "";
  }
}

/// An open image over bytes in memory; nothing is decoded yet.
struct OpenImage {
  std::unique_ptr<OIIO::Filesystem::IOMemReader> bytes;  // outlives `input`
  std::unique_ptr<OIIO::ImageInput> input;
};

absl::Status damaged(const std::string& detail) {
  std::string line = detail.substr(0, detail.find('\n'));
  for (char& c : line) c = c >= ' ' && c <= '~' ? c : '?';  // it may quote the file
  return absl::InvalidArgumentError(
      absl::StrCat("the image is damaged or truncated", line.empty() ? "" : ": ", line));
}

/// Channels of the file that become R, G, B and A; -1: there is none.
struct ChannelMap {
  int source[4] = {0, 1, 2, -1};
  std::size_t count = 3;
  int begin = 0, end = 3;  // the channels read
};

absl::StatusOr<ChannelMap> channel_map(const OIIO::ImageSpec& spec) {
  ChannelMap map;
  const int alpha = spec.alpha_channel;
  map.source[3] = spec.nchannels >= 4 && alpha < 0 ? -1 : alpha;
  if (spec.nchannels < 3) map.source[1] = map.source[2] = 0;
  for (int k = 0; k < 3; ++k) {
    static constexpr const char* kNames[] = {"R", "G", "B"};
    const int named = spec.channelindex(kNames[k]);
    if (named >= 0) map.source[k] = named;
    if (named < 0 && spec.nchannels >= 3) {
      return absl::InvalidArgumentError(absl::StrCat("the image has no channel ", kNames[k]));
    }
  }
  if (spec.nchannels == 2 && alpha < 0) map.source[3] = 1;
  map.count = map.source[3] >= 0 ? 4 : 3;
  map.begin = *std::min_element(map.source, map.source + map.count);
  map.end = *std::max_element(map.source, map.source + map.count) + 1;
  return map;
}

absl::Status check_header(const OIIO::ImageSpec& spec, const ChannelMap& map,
                          const PixelLimits& limits) {
  if (spec.width < 1 || spec.height < 1 || spec.depth > 1 || spec.nchannels < 1) {
    return absl::InvalidArgumentError("the image has no pixels");
  }
  if (spec.width > limits.side || spec.height > limits.side) {
    return absl::InvalidArgumentError(absl::StrCat("the image is ", spec.width, " x ", spec.height,
                                                   ", more than the limit of ", limits.side,
                                                   " a side"));
  }
  if (std::int64_t{spec.width} * spec.height > limits.pixels) {
    return absl::InvalidArgumentError(absl::StrCat("the image is ", spec.width, " x ", spec.height,
                                                   ", more than the limit of ", limits.pixels,
                                                   " pixels"));
  }
  // Decoded with all channels read first, then brought to 3 or 4.
  const auto channels = static_cast<std::uint64_t>(std::max(4, map.end - map.begin));
  const std::uint64_t bytes = static_cast<std::uint64_t>(spec.width) *
                              static_cast<std::uint64_t>(spec.height) * channels *
                              spec.format.size();
  if (bytes > static_cast<std::uint64_t>(limits.bytes)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the image takes ", bytes, " bytes decoded, more than the limit of ", limits.bytes));
  }
  return absl::OkStatus();
}

absl::StatusOr<OpenImage> open_image(std::span<const std::byte> file, ImageFormat format) {
  if (format == ImageFormat::ktx2) {
    return absl::UnimplementedError("a KTX2/Basis image, which this build cannot decode");
  }
  if (format == ImageFormat::unknown) {
    return absl::InvalidArgumentError(
        "not a PNG, JPEG, WebP, EXR or Radiance HDR image (by its first bytes)");
  }
  OpenImage open;
  open.bytes = std::make_unique<OIIO::Filesystem::IOMemReader>(const_cast<std::byte*>(file.data()),
                                                               file.size());
  // Created by format name, so that no other plugin ever looks at the bytes.
  open.input = OIIO::ImageInput::create(plugin_name(format));
  if (open.input == nullptr || !open.input->set_ioproxy(open.bytes.get())) {
    return absl::UnimplementedError(
        absl::StrCat("OpenImageIO cannot read ", plugin_name(format), " images from memory"));
  }
  open.input->threads(1);  // the caller has threads of its own
  OIIO::ImageSpec config, header;
  config["oiio:UnassociatedAlpha"] = 1;
  if (!open.input->open("memory", header, config)) return damaged(open.input->geterror());
  return open;
}

template <typename T>
bool read_pixels(OIIO::ImageInput& input, const ChannelMap& map, std::vector<T>& out) {
  const OIIO::ImageSpec spec = input.spec();
  const auto pixels = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height);
  const auto from = static_cast<std::size_t>(map.end - map.begin);
  std::vector<T> file(pixels * from);
  if (!input.read_image(0, 0, map.begin, map.end, OIIO::BaseTypeFromC<T>::value, file.data())) {
    return false;
  }
  bool same = from == map.count;
  for (std::size_t k = 0; k < map.count; ++k) {
    same = same && map.source[k] == map.begin + static_cast<int>(k);
  }
  if (same) {
    out = std::move(file);
    return true;
  }
  out.resize(pixels * map.count);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t k = 0; k < map.count; ++k) {
      out[i * map.count + k] = file[i * from + static_cast<std::size_t>(map.source[k] - map.begin)];
    }
  }
  return true;
}

/// Divides alpha out again: OpenImageIO's WebP reader multiplies it in, whatever it is asked.
void unassociate(Pixels& image) {
  if (image.channels != 4) return;
  for (std::size_t i = 0; i + 3 < image.u8.size(); i += 4) {
    const unsigned alpha = image.u8[i + 3];
    if (alpha == 0 || alpha == 255) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const unsigned code = (image.u8[i + k] * 255u + alpha / 2) / alpha;
      image.u8[i + k] = static_cast<std::uint8_t>(code > 255 ? 255 : code);
    }
  }
}

absl::StatusOr<Pixels> decode_file(std::span<const std::byte> file, const PixelLimits& limits) {
  const ImageFormat format = image_format(file);
  const auto open = open_image(file, format);
  if (!open.ok()) return open.status();
  OIIO::ImageInput& input = *open->input;
  const auto map = channel_map(input.spec());
  if (!map.ok()) return map.status();
  absl::Status valid = check_header(input.spec(), *map, limits);
  if (!valid.ok()) return valid;
  Pixels image;
  image.width = input.spec().width;
  image.height = input.spec().height;
  image.channels = static_cast<int>(map->count);
  const auto type = static_cast<OIIO::TypeDesc::BASETYPE>(input.spec().format.basetype);
  bool read = false;
  if (type == OIIO::TypeDesc::UINT8) {
    read = read_pixels(input, *map, image.u8);
  } else if (type == OIIO::TypeDesc::UINT16) {
    read = read_pixels(input, *map, image.u16);
  } else {
    read = read_pixels(input, *map, image.f32);
  }
  if (!read) return damaged(input.geterror());
  if (format == ImageFormat::webp) unassociate(image);
  return image;
}

class OpenImageIoEncoder final : public ImageEncoder {
 public:
  absl::Status start(ImageFormat format, std::int64_t width, std::int64_t height) {
    const bool png = format == ImageFormat::png;
    OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), png ? 4 : 3,
                         OIIO::TypeDesc::UINT8);
    spec.attribute("oiio:ColorSpace", "sRGB");
    if (png) spec.attribute("oiio:UnassociatedAlpha", 1);  // already divided by alpha
    if (!png) spec.attribute("Compression", "jpeg:95");
    output_ = OIIO::ImageOutput::create(plugin_name(format));
    if (output_ == nullptr) return absl::InternalError(OIIO::geterror());
    output_->threads(1);
    if (!output_->set_ioproxy(&memory_) || !output_->open("memory", spec)) return failure();
    return absl::OkStatus();
  }

  absl::Status write_rows(const std::uint8_t* codes, std::int64_t rows) override {
    const int end = next_ + static_cast<int>(rows);
    if (!output_->write_scanlines(next_, end, 0, OIIO::TypeDesc::UINT8, codes)) return failure();
    next_ = end;
    return absl::OkStatus();
  }

  absl::StatusOr<std::string> finish() override {
    if (!output_->close()) return failure();
    return std::string(bytes_.begin(), bytes_.end());
  }

 private:
  absl::Status failure() const { return absl::InternalError(output_->geterror()); }

  std::vector<unsigned char> bytes_;
  OIIO::Filesystem::IOVecOutput memory_{bytes_};
  std::unique_ptr<OIIO::ImageOutput> output_;
  int next_ = 0;
};

class OpenImageIoCodec final : public ImageCodec {
 public:
  absl::StatusOr<Pixels> decode(std::span<const std::byte> file,
                                const PixelLimits& limits) const override {
    try {
      return decode_file(file, limits);
    } catch (const std::exception& e) {
      return damaged(e.what());
    }
  }

  absl::StatusOr<std::unique_ptr<ImageEncoder>> encoder(ImageFormat format, std::int64_t width,
                                                        std::int64_t height) const override {
    auto encoder = std::make_unique<OpenImageIoEncoder>();
    absl::Status status = encoder->start(format, width, height);
    if (!status.ok()) return status;
    return encoder;
  }
};

}  // namespace
}  // namespace tessera::image

extern "C" const tessera::image::ImageCodec* tessera_image_codec();
extern "C" const tessera::image::ImageCodec* tessera_image_codec() {
  static const tessera::image::OpenImageIoCodec codec;
  return &codec;
}
