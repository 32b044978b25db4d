#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "worker/math/transform.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/gltf/decode/geometry_reader.h"

namespace tessera::render {

/// `base` with its morph targets added, weight by weight, in double, rounded once; normals and
/// tangents are made unit again. Targets without a weight count as 0.
Primitive morph(const BasePrimitive& base, const std::vector<double>& weights);

/// Joint matrices of a skin: world transform of each joint after its inverse bind matrix.
/// Errors: InvalidArgument "skins[i]: ..." for too few or non-finite inverse bind matrices.
absl::StatusOr<std::vector<Affine3d>> joint_matrices(const GltfModel& document,
                                                     std::int32_t skin_index,
                                                     const std::vector<Affine3d>& world);

/// A skinned primitive: its normals and tangents already in world space, positions kept apart in
/// double until the scene's centre is known.
struct SkinnedPrimitive {
  Primitive primitive;
  std::vector<Vec3d> world_positions;
};

/// Linear blend skinning of `posed` (the morphed primitive) with the influences of `base`.
/// Weights are scaled to a sum of 1. Where joints mirror, triangles and tangents are turned round,
/// so that a world-space copy has its front where the specification has it. Errors: InvalidArgument
/// when a joint number is too large.
absl::StatusOr<SkinnedPrimitive> skin(const BasePrimitive& base, Primitive posed,
                                      const std::vector<Affine3d>& joints);

}  // namespace tessera::render
