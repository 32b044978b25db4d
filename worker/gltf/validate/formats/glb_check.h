#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "worker/gltf/validate/findings/findings.h"

namespace tessera::render {

/// The chunks of a GLB that are glTF's.
struct GlbChunks {
  std::optional<std::string_view> json;
  std::optional<std::span<const std::byte>> binary;
  bool is_complete = false;  // the file ends with a chunk
};

/// Splits a GLB into its chunks and reports breaches of its layout. Source: glTF 2.0, chapter 4.
GlbChunks check_glb(std::span<const std::byte> file, ValidationFindings& findings);

}  // namespace tessera::render
