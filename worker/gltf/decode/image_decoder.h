#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Decodes a PNG, JPEG, WebP, EXR or Radiance file as image::decode() does, without converting its
/// codes. Checks the header before it allocates memory.
///
/// Errors: InvalidArgument for other formats, damaged files and files over the limits of
/// docs/reference/limits.md; ResourceExhausted if it takes more than `memory_bytes` decoded;
/// Unimplemented for KTX2.
absl::StatusOr<Image> decode_image(std::span<const std::byte> file, const std::string& name,
                                   std::uint64_t memory_bytes = UINT64_MAX);

/// Decodes an EXR or Radiance file as an environment map, linear RGB floats. Errors: as above.
absl::StatusOr<Image> decode_environment(std::span<const std::byte> file, const std::string& name,
                                         std::uint64_t memory_bytes = UINT64_MAX);

}  // namespace tessera::render
