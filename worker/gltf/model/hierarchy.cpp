#include "worker/gltf/model/hierarchy.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace tessera::render {

namespace {

/// Whether a node and all its ancestors are visible, by node.
std::vector<bool> visible_nodes(const std::vector<Node>& nodes) {
  std::vector<bool> out(nodes.size());
  for (const std::int32_t node : parents_first(nodes)) {
    const std::int32_t parent = nodes[node].parent;
    out[node] = nodes[node].visible && (parent == kNone || out[parent]);
  }
  return out;
}

}  // namespace

absl::Status link_parents(std::vector<Node>& nodes) {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (const std::int32_t child : nodes[i].children) {
      if (nodes[child].parent != kNone) {
        return absl::InvalidArgumentError(
            absl::StrCat("nodes[", child, "]: has two parents, ", nodes[child].parent, " and ", i));
      }
      nodes[child].parent = static_cast<std::int32_t>(i);
    }
  }
  // With at most one parent each, a node on a cycle is one that no root reaches.
  std::size_t reached = 0;
  std::vector<std::int32_t> open;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].parent == kNone) open.push_back(static_cast<std::int32_t>(i));
  }
  std::vector<bool> seen(nodes.size());
  while (!open.empty()) {
    const std::int32_t node = open.back();
    open.pop_back();
    seen[node] = true;
    ++reached;
    for (const std::int32_t child : nodes[node].children) open.push_back(child);
  }
  for (std::size_t i = 0; i < nodes.size() && reached < nodes.size(); ++i) {
    if (!seen[i]) {
      return absl::InvalidArgumentError(
          absl::StrCat("nodes[", i, "]: is its own ancestor (a cycle)"));
    }
  }
  return absl::OkStatus();
}

Affine3d local_transform(const Node& node) {
  if (node.matrix) return *node.matrix;
  double x = node.rotation.x, y = node.rotation.y, z = node.rotation.z, w = node.rotation.w;
  const double norm = x * x + y * y + z * z + w * w;
  if (norm > 0 && norm != 1 && std::isfinite(norm)) {
    const double length = std::sqrt(norm);
    x /= length, y /= length, z /= length, w /= length;
  } else if (norm != 1) {
    x = y = z = 0, w = 1;
  }
  const Vec3d s = node.scale;
  return {{Vec3d{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)} * s,
           Vec3d{2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)} * s,
           Vec3d{2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)} * s},
          node.translation};
}

std::vector<std::int32_t> parents_first(const std::vector<Node>& nodes) {
  std::vector<std::int32_t> roots;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].parent == kNone) roots.push_back(static_cast<std::int32_t>(i));
  }
  return depth_first(nodes, roots, HiddenNodes::included);
}

std::vector<Affine3d> world_transforms(const std::vector<Node>& nodes) {
  std::vector<Affine3d> world(nodes.size());
  for (const std::int32_t node : parents_first(nodes)) {
    const Affine3d local = local_transform(nodes[node]);
    const std::int32_t parent = nodes[node].parent;
    world[node] = parent == kNone ? local : world[parent] * local;
  }
  return world;
}

Vec3d unscaled_direction(const std::vector<Node>& nodes, std::int32_t node) {
  Vec3d direction{0, 0, -1};
  for (std::int32_t n = node; n != kNone; n = nodes[n].parent) {
    Node local = nodes[n];
    const Vec3d& s = local.scale;
    if (s.x == 0 || s.y == 0 || s.z == 0) local.scale = {1, 1, 1};
    direction = transform_vector(local_transform(local), direction);
  }
  return normalize(direction);
}

std::vector<std::int32_t> depth_first(const std::vector<Node>& nodes,
                                      const std::vector<std::int32_t>& roots, HiddenNodes hidden) {
  std::vector<std::int32_t> order;
  std::vector<std::int32_t> open(roots.rbegin(), roots.rend());
  const bool inner = std::any_of(roots.begin(), roots.end(),
                                 [&](std::int32_t r) { return nodes[r].parent != kNone; });
  if (inner && hidden == HiddenNodes::skipped) {
    const std::vector<bool> shown = visible_nodes(nodes);
    std::erase_if(open, [&](std::int32_t root) { return !shown[root]; });
  }
  while (!open.empty()) {
    const std::int32_t node = open.back();
    open.pop_back();
    if (!nodes[node].visible && hidden == HiddenNodes::skipped) continue;
    order.push_back(node);
    const auto& children = nodes[node].children;
    open.insert(open.end(), children.rbegin(), children.rend());
  }
  return order;
}

}  // namespace tessera::render
