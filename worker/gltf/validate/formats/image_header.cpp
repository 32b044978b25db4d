#include "worker/gltf/validate/formats/image_header.h"

#include <algorithm>
#include <array>

#include "worker/gltf/file/uri.h"
#include "worker/gltf/validate/formats/uri_rules.h"

namespace tessera::render {

namespace {

using State = ImageHeader::State;
using Bytes = std::span<const std::byte>;

constexpr std::string_view kJpeg = "image/jpeg", kPng = "image/png", kWebp = "image/webp";

std::uint32_t byte_at(Bytes data, std::size_t at) {
  return std::to_integer<std::uint32_t>(data[at]);
}

std::uint32_t big_endian(Bytes data, std::size_t at) {
  return byte_at(data, at) << 24U | byte_at(data, at + 1) << 16U | byte_at(data, at + 2) << 8U |
         byte_at(data, at + 3);
}

std::uint32_t little_endian(Bytes data, std::size_t at, int bytes) {
  std::uint32_t out = 0;
  for (int i = bytes - 1; i >= 0; --i) {
    out = out << 8U | byte_at(data, at + static_cast<std::size_t>(i));
  }
  return out;
}

bool begins_with(Bytes data, std::string_view magic, std::size_t at = 0) {
  if (data.size() < at + magic.size()) return false;
  for (std::size_t i = 0; i < magic.size(); ++i) {
    if (byte_at(data, at + i) != static_cast<unsigned char>(magic[i])) return false;
  }
  return true;
}

/// Start of frame: the segment with the size of the image. Source: ITU-T T.81, table B.1.
bool is_frame(std::uint32_t marker) {
  const bool other = marker == 0xC4 || marker == 0xC8 || marker == 0xCC;
  return ((marker & 0xF0U) == 0xC0 && !other) || marker == 0xDE;
}

bool has_segment(std::uint32_t marker) {
  return marker != 0x01 && (marker & 0xF8U) != 0xD0 && marker != 0xD8 && marker != 0xFF;
}

ImageHeader read_jpeg(Bytes data) {
  ImageHeader out{State::truncated, kJpeg};
  std::size_t at = 1;
  while (true) {
    while (at < data.size() && !has_segment(byte_at(data, at))) ++at;
    if (at + 3 > data.size()) return out;
    const std::uint32_t marker = byte_at(data, at);
    const std::size_t length = byte_at(data, at + 1) << 8U | byte_at(data, at + 2);
    if (length < 2) {
      out.state = State::damaged;
      return out;
    }
    at += 3;
    if (at + length - 2 > data.size()) return out;
    if (is_frame(marker)) {
      constexpr std::size_t kFrameBytes = 6;
      const bool usable = length - 2 >= kFrameBytes;
      const std::uint32_t channels = usable ? byte_at(data, at + 5) : 0;
      out.state = channels == 1 || channels == 3 ? State::valid : State::damaged;
      if (usable) {
        out.height = byte_at(data, at + 1) << 8U | byte_at(data, at + 2);
        out.width = byte_at(data, at + 3) << 8U | byte_at(data, at + 4);
      }
      return out;
    }
    at += length - 2;
  }
}

/// Colour space by the chunks of a PNG. Source: PNG specification, section 11.3.2.
class PngColour {
 public:
  void read(Bytes data, std::size_t chunk) {
    constexpr std::size_t kHeader = 8;
    if (begins_with(data, "sRGB", chunk + 4)) primaries_ = transfer_ = Space::srgb;
    if (begins_with(data, "iCCP", chunk + 4)) primaries_ = transfer_ = Space::custom;
    if (begins_with(data, "gAMA", chunk + 4) && transfer_ == Space::unknown) {
      const std::uint32_t gamma = big_endian(data, chunk + kHeader);
      transfer_ = gamma == 45455 || gamma == 100000 ? Space::srgb : Space::custom;
    }
    if (begins_with(data, "cHRM", chunk + 4) && primaries_ == Space::unknown) {
      constexpr std::array<std::uint32_t, 8> kSrgb = {31270, 32900, 64000, 33000,
                                                      30000, 60000, 15000, 6000};
      primaries_ = Space::srgb;
      for (std::size_t i = 0; i < kSrgb.size(); ++i) {
        if (big_endian(data, chunk + kHeader + 4 * i) != kSrgb[i]) primaries_ = Space::custom;
      }
    }
  }

  [[nodiscard]] bool is_custom() const {
    return primaries_ == Space::custom || transfer_ == Space::custom;
  }

 private:
  enum class Space : std::uint8_t { unknown, srgb, custom };
  Space primaries_ = Space::unknown, transfer_ = Space::unknown;
};

/// Whether a chunk has the length that its type requires.
bool has_right_length(Bytes data, std::size_t chunk, std::uint32_t length) {
  struct Required {
    std::string_view type;
    std::uint32_t length;
  };
  constexpr Required kRequired[] = {
      {"IHDR", 13}, {"cHRM", 32}, {"sRGB", 1}, {"pHYs", 9}, {"gAMA", 4}};
  return std::all_of(std::begin(kRequired), std::end(kRequired), [&](const Required& each) {
    return !begins_with(data, each.type, chunk + 4) || length == each.length;
  });
}

ImageHeader read_png(Bytes data) {
  ImageHeader out{State::truncated, kPng};
  PngColour colour;
  bool has_header = false;
  constexpr std::size_t kSignature = 8, kOverhead = 12, kHeader = 8;
  std::size_t at = kSignature;
  while (at + kHeader <= data.size()) {
    const std::uint32_t length = big_endian(data, at);
    if (begins_with(data, "IDAT", at + 4)) {
      out.state = has_header ? State::valid : State::damaged;
      out.has_ignored_features |= colour.is_custom();
      return out;
    }
    if (!has_right_length(data, at, length)) {
      out.state = State::damaged;
      return out;
    }
    if (data.size() - at < kOverhead + std::size_t{length}) return out;
    if (begins_with(data, "IHDR", at + 4)) {
      has_header = true;
      out.width = big_endian(data, at + kHeader);
      out.height = big_endian(data, at + kHeader + 4);
    }
    if (begins_with(data, "pHYs", at + 4)) {
      out.has_ignored_features =
          big_endian(data, at + kHeader) != big_endian(data, at + kHeader + 4);
    }
    colour.read(data, at);
    at += kOverhead + std::size_t{length};
  }
  return out;
}

/// Source: RFC 9649, sections 2.5 to 2.7.
ImageHeader read_webp(Bytes data) {
  constexpr std::size_t kHeaderBytes = 30, kLosslessBytes = 25;
  const bool lossless = begins_with(data, "VP8L", 12);
  if (data.size() < (lossless ? kLosslessBytes : kHeaderBytes)) return {State::truncated, kWebp};
  ImageHeader out{State::valid, kWebp};
  if (begins_with(data, "VP8 ", 12)) {
    out.width = little_endian(data, 26, 2) & 0x3FFFU;
    out.height = little_endian(data, 28, 2) & 0x3FFFU;
  } else if (lossless) {
    const std::uint32_t bits = little_endian(data, 21, 4);
    out.width = 1 + (bits & 0x3FFFU);
    out.height = 1 + (bits >> 14U & 0x3FFFU);
  } else if (begins_with(data, "VP8X", 12)) {
    constexpr std::uint32_t kAnimation = 2, kColourProfile = 32;
    out.has_ignored_features = (byte_at(data, 20) & (kAnimation | kColourProfile)) != 0;
    out.width = 1 + little_endian(data, 24, 3);
    out.height = 1 + little_endian(data, 27, 3);
  } else {
    out.state = State::damaged;
  }
  return out;
}

}  // namespace

std::string_view media_type_of_data(Bytes data) {
  constexpr std::size_t kMagicBytes = 14;
  if (data.size() < kMagicBytes) return "";
  if (begins_with(data, "\xFF\xD8\xFF")) return kJpeg;
  if (begins_with(data, "\x89PNG\r\n\x1A\n")) return kPng;
  if (begins_with(data, "RIFF") && begins_with(data, "WEBPVP", 8)) return kWebp;
  return begins_with(data, "\xABKTX 20\xBB\r\n\x1A\n") ? "image/ktx2" : "";
}

ImageHeader read_image_header(Bytes data) {
  const std::string_view type = media_type_of_data(data);
  if (type == kJpeg) return read_jpeg(data);
  if (type == kPng) return read_png(data);
  if (type == kWebp) return read_webp(data);
  return {};
}

std::optional<std::vector<std::byte>> image_data_of(std::string_view uri) {
  auto data = decode_data_uri(uri);
  if (!data.ok() || media_type_of_data(*data) != media_type_of(uri)) return std::nullopt;
  return *std::move(data);
}

}  // namespace tessera::render
