#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "absl/status/status.h"

namespace tessera::render {

/// Our own extensions (docs/extensions.md). Others' files are read leniently where viewers are;
/// what says TESSERA_ is meant for us, so a misplaced or misspelt one is a fault, not a surprise.

/// Whether `name` is one of ours that this version reads.
bool is_tessera_extension(std::string_view name);

/// Checks that every extension named TESSERA_* is known, stands where it means something, and is
/// listed in extensionsUsed. Members are the business of the extension's reader, which refuses
/// those it does not know (JsonView::allow). Errors: InvalidArgument "ELEMENT: FAULT".
absl::Status check_tessera_extensions(const nlohmann::json& root);

}  // namespace tessera::render
