#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace tessera::render {

/// Result of reading the header of an image.
struct ImageHeader {
  enum class State : std::uint8_t { valid, unrecognised, truncated, damaged };
  State state = State::unrecognised;
  std::string_view media_type;  // empty if the format is not recognised
  std::uint32_t width = 0, height = 0;
  /// The image has a colour space, pixels that are not square or an animation, which glTF ignores.
  bool has_ignored_features = false;
};

/// Reads the header of a JPEG, PNG or WebP image, up to the first pixels.
ImageHeader read_image_header(std::span<const std::byte> data);

/// Media type by the first bytes, of JPEG, PNG, WebP and KTX2; empty if it is none.
std::string_view media_type_of_data(std::span<const std::byte> data);

/// Bytes of a data URI, if they are an image of the media type that it declares.
std::optional<std::vector<std::byte>> image_data_of(std::string_view uri);

}  // namespace tessera::render
