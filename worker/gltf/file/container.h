#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::render {

/// The two parts of a glTF file, as views of its bytes.
struct GltfContainer {
  std::string_view json;
  std::span<const std::byte> bin;  // binary chunk of a GLB
  bool has_bin = false;
};

/// Splits `file`, a GLB (recognised by its magic) or JSON text. Checks chunk sizes, the size of the
/// JSON and its nesting depth, without parsing it. Errors: InvalidArgument "ELEMENT: FAULT".
absl::StatusOr<GltfContainer> split_container(std::span<const std::byte> file);

/// Maximum nesting depth of [ and { outside strings; stops counting beyond kMaxJsonDepth.
int json_depth(std::string_view json);

}  // namespace tessera::render
