#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "worker/gltf/decode/geometry_reader.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// `base` plus its weighted morph targets, computed in double and rounded once. Normals and
/// tangents are renormalised. Missing weights are 0.
Primitive morph(const BasePrimitive& base, const std::vector<double>& weights);

/// Joint matrices of a skin: world transform of each joint * its inverse bind matrix. Errors:
/// InvalidArgument "skins[i]: ..." for missing or non-finite inverse bind matrices.
absl::StatusOr<std::vector<Affine3d>> joint_matrices(const GltfModel& model,
                                                     std::int32_t skin_index,
                                                     const std::vector<Affine3d>& world);

/// A skinned primitive. Its normals and tangents are in world space; its positions stay in double
/// until the scene's centre is known.
struct SkinnedPrimitive {
  Primitive primitive;
  std::vector<Vec3d> world_positions;
};

/// Linear blend skinning of `posed` (the morphed primitive) with the influences of `base`, whose
/// weights are normalised to a sum of 1. Where joints mirror, triangles and tangents are flipped so
/// that front faces stay as specified. Errors: InvalidArgument if a joint index is out of range.
absl::StatusOr<SkinnedPrimitive> skin(const BasePrimitive& base, Primitive posed,
                                      const std::vector<Affine3d>& joints);

}  // namespace tessera::render
