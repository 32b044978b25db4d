#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "absl/status/status.h"

namespace tessera::render {

/// Checks of TESSERA_* extensions (docs/reference/gltf-support.md#tessera-extensions). Unknown
/// extensions of others are ignored as viewers do; a misplaced or misspelt TESSERA_ extension is an
/// error because the author meant Tessera to apply it.

/// Returns whether this version reads the TESSERA_ extension `name`.
bool is_tessera_extension(std::string_view name);

/// Checks that every extension named TESSERA_* is known, is allowed where it stands and is listed
/// in extensionsUsed. The reader of each extension checks its properties (JsonView::allow). Errors:
/// InvalidArgument "ELEMENT: FAULT".
absl::Status check_tessera_extensions(const nlohmann::json& root);

}  // namespace tessera::render
