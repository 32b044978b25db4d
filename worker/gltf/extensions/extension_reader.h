#pragma once

#include <nlohmann/json_fwd.hpp>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Reads images, textures and the extensions of nodes and meshes (lights, visibility, instancing,
/// variants), which tinygltf does not read or is not given. Requires read_core_model(). Errors:
/// InvalidArgument "ELEMENT: FAULT".
absl::Status read_node_extensions(const nlohmann::json& root, GltfModel& model);

/// Reads TESSERA_camera into model.cameras. Errors: InvalidArgument.
absl::Status read_camera_extensions(const nlohmann::json& root, GltfModel& model);

/// Reads TESSERA_texture of model.texture_sources. Requires read_images(). Errors:
/// InvalidArgument.
absl::Status read_texture_extensions(const nlohmann::json& root, GltfModel& model);

/// Reads images (decodes data URIs, resolves views, only names files) and textures. Errors:
/// InvalidArgument.
absl::Status read_images(const nlohmann::json& root, GltfModel& model);

/// Reads the material extensions into model.materials. Errors: InvalidArgument.
absl::Status read_material_extensions(const nlohmann::json& root, GltfModel& model);

}  // namespace tessera::render
