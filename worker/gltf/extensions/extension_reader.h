#pragma once

#include <nlohmann/json_fwd.hpp>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Reads what tinygltf does not know or is not shown: images, textures, and the extensions of
/// nodes and meshes (lights, visibility, instancing, variants). Requires read_core_model().
/// Errors: InvalidArgument "ELEMENT: FAULT".
absl::Status read_node_extensions(const nlohmann::json& root, GltfModel& document);

/// Folds TESSERA_camera into document.cameras. Errors: InvalidArgument.
absl::Status read_camera_extensions(const nlohmann::json& root, GltfModel& document);

/// TESSERA_texture of document.texture_sources, which come from read_images().
/// Errors: InvalidArgument.
absl::Status read_texture_extensions(const nlohmann::json& root, GltfModel& document);

/// Images (data URIs decoded, views resolved, files only named) and textures.
/// Errors: InvalidArgument.
absl::Status read_images(const nlohmann::json& root, GltfModel& document);

/// Folds the material extensions into document.materials. Errors: InvalidArgument.
absl::Status read_material_extensions(const nlohmann::json& root, GltfModel& document);

}  // namespace tessera::render
