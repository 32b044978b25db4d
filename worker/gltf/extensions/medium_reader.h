#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "absl/status/status.h"
#include "worker/gltf/file/json_view.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Reads TESSERA_medium of a material (docs/reference/extensions/TESSERA_medium.md). nullopt if
/// absent. Reports faults to `fault`.
std::optional<Medium> read_medium(const JsonView& object, const GltfModel& model, JsonFault& fault);

/// Reads TESSERA_medium of model.scenes. Errors: InvalidArgument.
absl::Status read_atmospheres(const nlohmann::json& root, GltfModel& model);

}  // namespace tessera::render
