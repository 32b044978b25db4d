#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "absl/status/status.h"
#include "worker/scene/document.h"
#include "worker/scene/json_view.h"

namespace tessera::render {

/// TESSERA_medium of a material (docs/extensions.md); nullopt of an absent one. Faults go to
/// `fault`.
std::optional<Medium> read_medium(const JsonView& look, const Document& document, JsonFault& fault);

/// TESSERA_medium of document.scenes. Errors: InvalidArgument.
absl::Status read_atmospheres(const nlohmann::json& root, Document& document);

}  // namespace tessera::render
