#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::render {

/// The two parts of a glTF file, as views into its bytes.
struct GltfContainer {
  std::string_view json;
  std::span<const std::byte> bin;  // the GLB's binary chunk
  bool has_bin = false;
};

/// Splits `file`, a GLB by its magic or else JSON text, and checks chunk sizes, the size of the
/// JSON and its nesting depth without parsing it.
///
/// Errors: InvalidArgument "ELEMENT: FAULT".
absl::StatusOr<GltfContainer> split_container(std::span<const std::byte> file);

/// Deepest nesting of [ and { outside strings; stops counting beyond kMaxJsonDepth.
int json_depth(std::string_view json);

}  // namespace tessera::render
