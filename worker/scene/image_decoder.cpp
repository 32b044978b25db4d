#include "worker/scene/image_decoder.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <cmath>
#include <cstring>
#include <exception>
#include <memory>

#include "absl/strings/str_cat.h"
#include "worker/scene/limits.h"

namespace tessera::render {

namespace {

bool begins_with(std::span<const std::byte> file, std::string_view magic, std::size_t at = 0) {
  return file.size() >= at + magic.size() &&
         std::memcmp(file.data() + at, magic.data(), magic.size()) == 0;
}

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

absl::Status check_header(const OIIO::ImageSpec& spec) {
  if (spec.width < 1 || spec.height < 1 || spec.depth > 1 || spec.nchannels < 1) {
    return absl::InvalidArgumentError("the image has no pixels");
  }
  if (spec.width > kMaxImageSide || spec.height > kMaxImageSide) {
    return absl::InvalidArgumentError(absl::StrCat("the image is ", spec.width, " x ", spec.height,
                                                   ", more than the limit of ", kMaxImageSide,
                                                   " a side"));
  }
  // Decoded with all channels of the file first, then brought to 3 or 4.
  const auto channels = static_cast<std::uint64_t>(spec.nchannels < 4 ? 4 : spec.nchannels);
  const std::uint64_t bytes = static_cast<std::uint64_t>(spec.width) *
                              static_cast<std::uint64_t>(spec.height) * channels *
                              spec.format.size();
  if (bytes > static_cast<std::uint64_t>(kMaxImageBytes)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the image takes ", bytes, " bytes decoded, more than the limit of ", kMaxImageBytes));
  }
  return absl::OkStatus();
}

absl::StatusOr<OpenImage> open_image(std::span<const std::byte> file) {
  const ImageFormat format = image_format(file);
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
  OIIO::ImageSpec config, header;
  config["oiio:UnassociatedAlpha"] = 1;
  if (!open.input->open("memory", header, config)) return damaged(open.input->geterror());
  absl::Status valid = check_header(open.input->spec());
  if (!valid.ok()) return valid;
  return open;
}

/// Channels of the file that become R, G, B and A; -1: there is none.
struct ChannelMap {
  int source[4] = {0, 1, 2, -1};
  int count = 3;
};

ChannelMap channel_map(const OIIO::ImageSpec& spec) {
  ChannelMap map;
  const int alpha = spec.alpha_channel;
  map.source[3] = spec.nchannels >= 4 && alpha < 0 ? -1 : alpha;
  if (spec.nchannels < 3) map.source[1] = map.source[2] = 0;
  for (int k = 0; k < 3; ++k) {
    static constexpr const char* kNames[] = {"R", "G", "B"};
    const int named = spec.channelindex(kNames[k]);
    if (named >= 0) map.source[k] = named;
  }
  if (spec.nchannels == 2 && alpha < 0) map.source[3] = 1;
  map.count = map.source[3] >= 0 ? 4 : 3;
  return map;
}

template <typename T>
bool read_pixels(OIIO::ImageInput& input, OIIO::TypeDesc type, std::vector<T>& out,
                 std::int32_t& channels) {
  const OIIO::ImageSpec spec = input.spec();
  const auto pixels = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height);
  const auto from = static_cast<std::size_t>(spec.nchannels);
  std::vector<T> file(pixels * from);
  if (!input.read_image(0, 0, 0, spec.nchannels, type, file.data())) return false;
  const ChannelMap map = channel_map(spec);
  channels = map.count;
  const bool same = spec.nchannels == map.count && map.source[0] == 0 && map.source[1] == 1 &&
                    map.source[2] == 2 && (map.count == 3 || map.source[3] == 3);
  if (same) {
    out = std::move(file);
    return true;
  }
  const auto to = static_cast<std::size_t>(map.count);
  out.resize(pixels * to);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t k = 0; k < to; ++k) {
      out[i * to + k] = file[i * from + static_cast<std::size_t>(map.source[k])];
    }
  }
  return true;
}

/// Divides alpha out again: OpenImageIO's WebP reader multiplies it in, whatever it is asked.
void unassociate(Image& image) {
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

absl::StatusOr<Image> decode_open(OIIO::ImageInput& input, const std::string& name) {
  Image image;
  image.name = name;
  image.width = input.spec().width;
  image.height = input.spec().height;
  const OIIO::TypeDesc::BASETYPE type =
      static_cast<OIIO::TypeDesc::BASETYPE>(input.spec().format.basetype);
  bool read = false;
  if (type == OIIO::TypeDesc::UINT8) {
    read = read_pixels(input, OIIO::TypeDesc::UINT8, image.u8, image.channels);
  } else if (type == OIIO::TypeDesc::UINT16) {
    image.storage = Image::Storage::u16;
    read = read_pixels(input, OIIO::TypeDesc::UINT16, image.u16, image.channels);
  } else {
    image.storage = Image::Storage::f32;
    read = read_pixels(input, OIIO::TypeDesc::FLOAT, image.f32, image.channels);
  }
  if (!read) return damaged(input.geterror());
  return image;
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

absl::StatusOr<ImageHeader> read_image_header(std::span<const std::byte> file) {
  try {
    const auto open = open_image(file);
    if (!open.ok()) return open.status();
    const OIIO::ImageSpec& spec = open->input->spec();
    return ImageHeader{spec.width, spec.height, channel_map(spec).count,
                       static_cast<int>(spec.format.size())};
  } catch (const std::exception& e) {
    return damaged(e.what());
  }
}

absl::StatusOr<Image> decode_image(std::span<const std::byte> file, const std::string& name) {
  try {
    const auto open = open_image(file);
    if (!open.ok()) return open.status();
    auto image = decode_open(*open->input, name);
    if (image.ok() && image_format(file) == ImageFormat::webp) unassociate(*image);
    return image;
  } catch (const std::exception& e) {
    return damaged(e.what());
  }
}

absl::StatusOr<Image> decode_environment(std::span<const std::byte> file, const std::string& name) {
  const ImageFormat format = image_format(file);
  if (format != ImageFormat::exr && format != ImageFormat::hdr) {
    return absl::InvalidArgumentError("not an EXR or Radiance HDR image (by its first bytes)");
  }
  auto decoded = decode_image(file, name);
  if (!decoded.ok()) return decoded.status();
  Image sky;
  sky.name = name;
  sky.width = decoded->width;
  sky.height = decoded->height;
  sky.channels = 3;
  sky.storage = Image::Storage::f32;
  if (decoded->storage != Image::Storage::f32) {
    return absl::InvalidArgumentError("the sky's pixels are not floating point");
  }
  const auto channels = static_cast<std::size_t>(decoded->channels);
  const std::size_t pixels = decoded->f32.size() / channels;
  sky.f32.resize(pixels * 3);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const float v = decoded->f32[i * channels + k];
      if (!std::isfinite(v) || v < 0) {
        return absl::InvalidArgumentError(absl::StrCat("pixel ", i % sky.width, ", ", i / sky.width,
                                                       " is negative or not finite"));
      }
      sky.f32[i * 3 + k] = v;
    }
  }
  return sky;
}

}  // namespace tessera::render
