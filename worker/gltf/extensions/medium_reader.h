#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/gltf/file/json_view.h"

namespace tessera::render {

/// TESSERA_medium of a material (docs/extensions.md); nullopt of an absent one. Faults go to
/// `fault`.
std::optional<Medium> read_medium(const JsonView& look, const GltfModel& document, JsonFault& fault);

/// TESSERA_medium of document.scenes. Errors: InvalidArgument.
absl::Status read_atmospheres(const nlohmann::json& root, GltfModel& document);

}  // namespace tessera::render
