#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "worker/math/transform.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Sets every node's parent from the children lists.
/// Errors: InvalidArgument for a node with two parents or a cycle.
absl::Status link_parents(std::vector<Node>& nodes);

/// A node's own transform: its matrix, or translation after rotation after scale. Quaternions are
/// normalised first; the zero quaternion rotates nothing.
Affine3d local_transform(const Node& node);

/// World transform of every node, composed in double from the roots down.
std::vector<Affine3d> world_transforms(const std::vector<Node>& nodes);

/// A node's -z in the world, unit, by rotations alone where a scale is 0: lights point there
/// whatever their scale (KHR_lights_punctual). 0 where matrices leave nothing of it.
Vec3d unscaled_direction(const std::vector<Node>& nodes, std::int32_t node);

enum class HiddenNodes { left_out, included };

/// The nodes beneath `roots`, depth first, each before its children. Hidden are whole subtrees
/// (KHR_node_visibility). Requires link_parents().
std::vector<std::int32_t> depth_first(const std::vector<Node>& nodes,
                                      const std::vector<std::int32_t>& roots,
                                      HiddenNodes hidden = HiddenNodes::left_out);

}  // namespace tessera::render
