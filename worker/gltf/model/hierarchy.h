#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// Sets the parent of every node from the lists of children.
/// Errors: InvalidArgument for a node with two parents or a cycle.
absl::Status link_parents(std::vector<Node>& nodes);

/// All nodes, parents before children. Requires link_parents().
std::vector<std::int32_t> parents_first(const std::vector<Node>& nodes);

/// Local transform of a node: its matrix, or translation * rotation * scale. Quaternions are
/// normalised; a zero quaternion is the identity.
Affine3d local_transform(const Node& node);

/// World transform of every node, computed in double from the roots down.
std::vector<Affine3d> world_transforms(const std::vector<Node>& nodes);

/// World direction of a node's -Z axis, unit length. Where a scale is 0, it follows from the
/// rotations alone, because the direction of a light does not depend on its scale
/// (KHR_lights_punctual). Zero if the node's matrices leave it undefined.
Vec3d unscaled_direction(const std::vector<Node>& nodes, std::int32_t node);

enum class HiddenNodes { skipped, included };

/// Nodes below `roots` in depth-first order, parents before children. An invisible node hides its
/// subtree (KHR_node_visibility), also if it is above a root. Requires link_parents().
std::vector<std::int32_t> depth_first(const std::vector<Node>& nodes,
                                      const std::vector<std::int32_t>& roots,
                                      HiddenNodes hidden = HiddenNodes::skipped);

}  // namespace tessera::render
