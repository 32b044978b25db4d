#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// EXT_mesh_gpu_instancing: transform of each instance relative to its node. Requires a non-empty
/// node.instancing with accessors of equal length. Errors: those of read_vec3(); InvalidArgument
/// "accessors[i]: ..." for an accessor without a bufferView.
absl::StatusOr<std::vector<Affine3d>> instance_transforms(const GltfModel& model, const Node& node);

}  // namespace tessera::render
