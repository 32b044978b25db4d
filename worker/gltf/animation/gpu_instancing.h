#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "worker/math/transform.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// EXT_mesh_gpu_instancing: the transform of each instance beneath its node.
/// Errors: those of read_vec3(); InvalidArgument "accessors[i]: ..." for one without a bufferView.
/// Requires: node.instancing is not empty, and its accessors are of one length.
absl::StatusOr<std::vector<Affine3d>> instance_transforms(const GltfModel& document,
                                                          const Node& node);

}  // namespace tessera::render
