#include "worker/scene/visible_bounds.h"

#include <vector>

#include "worker/geometry/shapes/shape_support.h"

namespace tessera::render {
namespace {

/// Calls visit(vertex) for the vertices of all triangles.
template <typename Visit>
void for_each_corner(const Mesh& mesh, const Visit& visit) {
  for (const Primitive& p : mesh.primitives) {
    for (const auto& triangle : p.triangles) {
      for (const std::uint32_t v : triangle) visit(Vec3d(p.positions[v]));
    }
  }
}

/// An infinite plane counts as its origin.
bool is_unbounded(const Mesh& mesh) {
  return mesh.shape != nullptr && !mesh.shape->bounded();
}

Box3d object_box(const Mesh& mesh) {
  if (is_unbounded(mesh)) return {{0, 0, 0}, {0, 0, 0}};
  if (mesh.shape != nullptr) return {Vec3d(mesh.shape->bounds.lo), Vec3d(mesh.shape->bounds.hi)};
  Box3d box;
  for_each_corner(mesh, [&](const Vec3d& p) { box.extend(p); });
  return box;
}

/// Box of the corners of a transformed box.
Box3d loose_box(const Affine3d& m, const Box3d& box) {
  Box3d out;
  for (unsigned corner = 0; corner < 8 && !box.empty(); ++corner) {
    out.extend(transform_point(
        m, Vec3d{(corner & 1) != 0 ? box.hi.x : box.lo.x, (corner & 2) != 0 ? box.hi.y : box.lo.y,
                 (corner & 4) != 0 ? box.hi.z : box.lo.z}));
  }
  return out;
}

Box3d tight_box(const Affine3d& m, const Mesh& mesh) {
  Box3d out;
  if (mesh.shape == nullptr) {
    for_each_corner(mesh, [&](const Vec3d& p) { out.extend(transform_point(m, p)); });
    return out;
  }
  if (is_unbounded(mesh)) return {m.translation, m.translation};
  for (int k = 0; k < 3; ++k) {
    const Vec3d& row = m.rows[static_cast<std::size_t>(k)];
    out.lo[k] = m.translation[k] - support(*mesh.shape, -row);
    out.hi[k] = m.translation[k] + support(*mesh.shape, row);
  }
  return out;
}

/// Indices of the boxes that reach farthest in the six directions of the axes.
std::vector<std::size_t> outermost(const std::vector<Box3d>& boxes) {
  std::vector<std::size_t> out;
  for (int k = 0; k < 3; ++k) {
    std::size_t low = 0, high = 0;
    for (std::size_t i = 1; i < boxes.size(); ++i) {
      if (boxes[i].lo[k] < boxes[low].lo[k]) low = i;
      if (boxes[i].hi[k] > boxes[high].hi[k]) high = i;
    }
    out.insert(out.end(), {low, high});
  }
  return out;
}

}  // namespace

Box3d visible_bounds(const Scene& scene) {
  std::vector<Box3d> meshes, boxes;
  for (const Mesh& mesh : scene.meshes) meshes.push_back(object_box(mesh));
  for (const Instance& instance : scene.instances) {
    const Box3d& mesh = meshes[static_cast<std::size_t>(instance.mesh)];
    boxes.push_back(instance.flat ? Box3d{} : loose_box(instance.object_to_world, mesh));
  }
  Box3d all;
  const auto add = [&](std::size_t i) {
    if (boxes[i].empty() || (all.contains(boxes[i].lo) && all.contains(boxes[i].hi))) return;
    const Instance& instance = scene.instances[i];
    all.extend(
        tight_box(instance.object_to_world, scene.meshes[static_cast<std::size_t>(instance.mesh)]));
    boxes[i] = {};  // done
  };
  if (boxes.empty()) return all;
  // The outermost instances come first, so that most others lie within their box.
  for (const std::size_t i : outermost(boxes)) add(i);
  for (std::size_t i = 0; i < boxes.size(); ++i) add(i);
  return all;
}

}  // namespace tessera::render
