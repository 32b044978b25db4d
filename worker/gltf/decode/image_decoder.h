#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Decodes a PNG, JPEG, WebP, EXR or Radiance file as image::decode does: codes are kept.
///
/// Errors: InvalidArgument for other formats, damaged files and files over the limits of
/// farm.md, section 9; Unimplemented for KTX2. Nothing is allocated before the header is checked.
absl::StatusOr<Image> decode_image(std::span<const std::byte> file, const std::string& name);

/// An EXR or Radiance file as a linear float RGB sky.
absl::StatusOr<Image> decode_environment(std::span<const std::byte> file, const std::string& name);

}  // namespace tessera::render
