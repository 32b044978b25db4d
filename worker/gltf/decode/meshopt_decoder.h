#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace tessera::render {

/// Layout of a view as EXT_meshopt_compression declares it.
struct MeshoptLayout {
  std::size_t count = 0, stride = 0;
  std::string_view mode;    // ATTRIBUTES, TRIANGLES or INDICES
  std::string_view filter;  // "", NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL
};

/// Decodes `encoded` to count * stride bytes. Checks the layout before it allocates memory. Errors:
/// InvalidArgument.
absl::StatusOr<std::vector<std::byte>> decode_meshopt(std::span<const std::byte> encoded,
                                                      const MeshoptLayout& layout);

}  // namespace tessera::render
