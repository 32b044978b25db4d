#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// By node: whether it belongs to a solid, as the node with TESSERA_csg or below it. `order`:
/// visible nodes, depth first.
std::vector<bool> nodes_in_solids(const std::vector<Node>& nodes,
                                  const std::vector<std::int32_t>& order);

/// Builds scene.solids from the nodes with TESSERA_csg, after the instances of all nodes in `order`
/// (depth first) were added, with Instance::operand set by nodes_in_solids(). Operands are the
/// children of such a node; a child without mesh, shape or operation stands for the union of its
/// own children.
///
/// Errors: InvalidArgument "nodes[i]: ..." for an operand that is open, missing, or placed by
/// EXT_mesh_gpu_instancing.
absl::Status assemble_solids(const std::vector<Node>& nodes, const std::vector<std::int32_t>& order,
                             Scene& scene);

}  // namespace tessera::render
