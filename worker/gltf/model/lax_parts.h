#pragma once

#include <nlohmann/json_fwd.hpp>

#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Adds warnings to model.problems for parts that break the specification but are used, because
/// many files have them: extensions that extensionsUsed does not list (once per name), emissive
/// factors outside [0, 1], and nodes with a matrix beside translation, rotation or scale.
void warn_of_lax_parts(const nlohmann::json& root, GltfModel& model);

}  // namespace tessera::render
