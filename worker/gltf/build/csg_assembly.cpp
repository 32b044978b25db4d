#include "worker/gltf/build/csg_assembly.h"

#include <map>
#include <string>

#include "absl/strings/str_cat.h"
#include "worker/accel/overlap/mesh_overlap.h"

namespace tessera::render {
namespace {

/// Records the steps of one solid.
class SolidAssembler {
 public:
  SolidAssembler(const std::vector<Node>& nodes,
                 const std::map<std::int32_t, std::uint32_t>& instances, Scene& scene)
      : nodes_(nodes), instances_(instances), scene_(scene) {}

  /// Appends the steps of the node and all nodes below it. Keeps its own stack, as nodes may be
  /// nested deeper than the program's stack allows.
  absl::Status add(std::int32_t root, CsgSolid& solid) {
    std::vector<Level> path;
    absl::Status status = enter(root, solid, path);
    while (status.ok() && !path.empty()) {
      Level& level = path.back();
      const Node& node = nodes_[static_cast<std::size_t>(level.node)];
      if (level.done_count < node.children.size()) {
        status = enter(node.children[level.done_count++], solid, path);
        continue;
      }
      solid.steps.push_back({false, node.csg.value_or(CsgOperation::unite),
                             static_cast<std::uint32_t>(node.children.size())});
      path.pop_back();
    }
    return status;
  }

 private:
  /// A node on the path from the root, and how many of its children have been added.
  struct Level {
    std::int32_t node;
    std::size_t done_count = 0;
  };

  /// Adds an operand, or appends an inner node to the path.
  absl::Status enter(std::int32_t index, CsgSolid& solid, std::vector<Level>& path) {
    const Node& node = nodes_[static_cast<std::size_t>(index)];
    if (node.mesh != kNone || node.shape != nullptr) return add_operand(index, solid);
    if (node.children.empty()) return fault(index, "a CSG operand needs a mesh, shape or children");
    path.push_back({index});
    return absl::OkStatus();
  }

  static absl::Status fault(std::int32_t node, const std::string& message) {
    return absl::InvalidArgumentError(absl::StrCat("nodes[", node, "]: ", message));
  }

  absl::Status add_operand(std::int32_t index, CsgSolid& solid) {
    const Node& node = nodes_[static_cast<std::size_t>(index)];
    if (!node.children.empty()) {
      return fault(index, "a CSG operand with a mesh or shape cannot have children as well");
    }
    if (!node.instancing.empty()) {
      return fault(index, "a CSG operand cannot have EXT_mesh_gpu_instancing");
    }
    const auto found = instances_.find(index);
    if (found == instances_.end()) {  // hidden, empty, or flattened by its transform at this time
      solid.steps.push_back({false, CsgOperation::unite, 0});
      return absl::OkStatus();
    }
    const Instance& instance = scene_.instances[found->second];
    const Mesh& mesh = scene_.meshes[static_cast<std::size_t>(instance.mesh)];
    if (mesh.shape != nullptr) {
      if (!mesh.shape->closed()) {
        return fault(index, "the shape is open, so it has no inside; CSG needs closed operands");
      }
    } else {
      const std::int64_t open =
          boundary_edges(mesh, std::vector<bool>(mesh.primitives.size(), true));
      if (open > 0) {
        return fault(index, absl::StrCat("the mesh is open at ", open,
                                         " edges, so it has no inside; CSG needs closed operands"));
      }
    }
    if (solid.count == 0) solid.first = found->second;
    solid.steps.push_back({true, CsgOperation::unite, solid.count++});
    return absl::OkStatus();
  }

  const std::vector<Node>& nodes_;
  const std::map<std::int32_t, std::uint32_t>& instances_;
  Scene& scene_;
};

}  // namespace

std::vector<bool> nodes_in_solids(const std::vector<Node>& nodes,
                                  const std::vector<std::int32_t>& order) {
  std::vector<bool> inside(nodes.size());
  for (const std::int32_t index : order) {
    const Node& node = nodes[static_cast<std::size_t>(index)];
    const bool nested = node.parent != kNone && inside[static_cast<std::size_t>(node.parent)];
    inside[static_cast<std::size_t>(index)] = node.csg || nested;
  }
  return inside;
}

absl::Status assemble_solids(const std::vector<Node>& nodes, const std::vector<std::int32_t>& order,
                             Scene& scene) {
  const std::vector<bool> inside = nodes_in_solids(nodes, order);
  std::map<std::int32_t, std::uint32_t> instances;  // by node; built on first use
  for (const std::int32_t index : order) {
    const Node& node = nodes[static_cast<std::size_t>(index)];
    if (!node.csg) continue;
    if (node.parent != kNone && inside[static_cast<std::size_t>(node.parent)]) continue;
    if (instances.empty()) {
      for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
        instances.emplace(scene.instances[i].node, i);
      }
    }
    CsgSolid solid;
    solid.node = index;
    absl::Status status = SolidAssembler(nodes, instances, scene).add(index, solid);
    if (!status.ok()) return status;
    if (solid.count > 0) scene.solids.push_back(std::move(solid));
  }
  return absl::OkStatus();
}

}  // namespace tessera::render
