#pragma once

#include <nlohmann/json_fwd.hpp>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Decodes every EXT_meshopt_compression view into a buffer of its own and makes the view a plain
/// one. Requires resolve_buffers(). Adds damaged views to model.faults.
absl::Status expand_meshopt(nlohmann::json& root, GltfModel& model);

/// Decodes every KHR_draco_mesh_compression primitive and gives its accessors plain views. Requires
/// resolve_buffers() and expand_meshopt(). Adds meshes with damaged primitives to model.faults.
absl::Status expand_draco(nlohmann::json& root, GltfModel& model);

}  // namespace tessera::render
