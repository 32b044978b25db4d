#include "worker/inspect/solid_check.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/accel/overlap/mesh_overlap.h"
#include "worker/geometry/exact_sign.h"

namespace tessera::render {
namespace {

using nlohmann::json;

/// Maximum number of pairs listed per mesh; all are counted.
constexpr std::size_t kMaxListed = 100;

bool is_solid(const Material& material) {
  return material.transmission > 0 && material.has_volume;
}

/// Which primitives bound a solid or a medium.
std::vector<bool> bounding_primitives(const Scene& scene, const Mesh& mesh) {
  std::vector<bool> bounds;
  for (const Primitive& p : mesh.primitives) {
    const Material& material = scene.materials[static_cast<std::size_t>(p.material)];
    bounds.push_back(is_solid(material) || material.medium);
  }
  return bounds;
}

TriangleCorners placed(const Scene& scene, const Instance& instance, const OverlapPair::Id& id) {
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  const Primitive& p = mesh.primitives[id.primitive];
  TriangleCorners corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3d corner(p.positions[p.triangles[id.triangle][k]]);
    corners[k] = Vec3f(transform_point(instance.object_to_world, corner));
  }
  return corners;
}

bool in_one_plane(const TriangleCorners& a, const TriangleCorners& b) {
  return std::all_of(b.begin(), b.end(), [&](const Vec3f& corner) {
    return side_of_plane(a[0], a[1], a[2], corner) == 0;
  });
}

/// Warns of solids with coincident surfaces in scenes with priorities. Ray order then decides which
/// solid is entered first, and the gap between them belongs to neither.
void check_touching(const Scene& scene, std::vector<Problem>* out) {
  const bool nested = std::any_of(scene.materials.begin(), scene.materials.end(),
                                  [](const Material& m) { return m.optics.has_priority; });
  if (!nested) return;
  const auto bounds = [&](const Instance& instance, const OverlapPair::Id& id) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    const auto material = static_cast<std::size_t>(mesh.primitives[id.primitive].material);
    return is_solid(scene.materials[material]);
  };
  for (const InstanceOverlap& overlap : instance_overlaps(scene)) {
    const Instance &a = scene.instances[overlap.a], &b = scene.instances[overlap.b];
    const auto touching =
        std::count_if(overlap.pairs.begin(), overlap.pairs.end(), [&](const OverlapPair& pair) {
          return bounds(a, pair.a) && bounds(b, pair.b) &&
                 in_one_plane(placed(scene, a, pair.a), placed(scene, b, pair.b));
        });
    if (touching == 0) continue;
    out->push_back({Problem::Severity::warning, absl::StrCat("nodes[", b.node, "]"),
                    absl::StrCat("surface coincides with nodes[", a.node, "] (", touching,
                                 " triangle pairs); let the solids overlap and set `priority`")});
  }
}

/// Number of edges at which the surface is open by more than a millionth of the mesh's size.
/// Smaller gaps come from rounding of seams and are practically never hit.
std::int64_t wide_open_edges(const Mesh& mesh, const std::vector<bool>& primitives) {
  Box3f box;
  for (const Primitive& p : mesh.primitives) {
    for (const Vec3f& at : p.positions) box.extend(at);
  }
  return boundary_edges(mesh, primitives, 1e-6 * static_cast<double>(max_abs(box.hi - box.lo)));
}

json listed(const Mesh& a, const Mesh& b, const std::vector<OverlapPair>& pairs) {
  json list = json::array();
  for (std::size_t i = 0; i < std::min(pairs.size(), kMaxListed); ++i) {
    list.push_back({a.primitives[pairs[i].a.primitive].id, pairs[i].a.triangle,
                    b.primitives[pairs[i].b.primitive].id, pairs[i].b.triangle});
  }
  return list;
}

json mesh_report(const Mesh& mesh) {
  const std::int64_t open = boundary_edges(mesh, std::vector<bool>(mesh.primitives.size(), true));
  const std::vector<OverlapPair> pairs = self_intersections(mesh);
  return {{"name", mesh.name},
          {"closed", open == 0},
          {"open_edges", open},
          {"pair_count", pairs.size()},
          {"pairs", listed(mesh, mesh, pairs)}};
}

}  // namespace

std::vector<Problem> check_solids(const Scene& scene) {
  std::vector<Problem> out;
  for (const Mesh& mesh : scene.meshes) {
    const std::vector<bool> solid = bounding_primitives(scene, mesh);
    if (std::find(solid.begin(), solid.end(), true) == solid.end()) continue;
    const auto& first = mesh.primitives[static_cast<std::size_t>(
        std::find(solid.begin(), solid.end(), true) - solid.begin())];
    const bool medium =
        scene.materials[static_cast<std::size_t>(first.material)].medium.has_value();
    const auto warn = [&](const std::string& fault) {
      out.push_back({Problem::Severity::warning, absl::StrCat("mesh \"", mesh.name, "\""),
                     absl::StrCat(medium ? "its material encloses a medium"
                                         : "its material is a solid (it has a thickness)",
                                  ", but ", fault)});
    };
    if (mesh.shape != nullptr && !mesh.shape->closed()) {
      warn("the shape is open; light that enters it may never leave");
    } else if (boundary_edges(mesh, solid) > 0) {
      const std::int64_t open = wide_open_edges(mesh, solid);
      if (open == 0) continue;
      warn(absl::StrCat("the surface is open at ", open,
                        " edges; light that enters it may never leave"));
    } else if (const auto pairs = self_intersections(mesh, solid); !pairs.empty()) {
      warn(absl::StrCat("the surface intersects itself (", pairs.size(),
                        " triangle pairs); overlaps count as inside twice"));
    }
  }
  check_touching(scene, &out);
  return out;
}

std::string overlap_report(const Scene& scene) {
  json meshes = json::array(), instances = json::array();
  for (const Mesh& mesh : scene.meshes) meshes.push_back(mesh_report(mesh));
  for (const InstanceOverlap& overlap : instance_overlaps(scene)) {
    const Instance &a = scene.instances[overlap.a], &b = scene.instances[overlap.b];
    instances.push_back(
        {{"instances", {overlap.a, overlap.b}},
         {"nodes", {a.node, b.node}},
         {"pair_count", overlap.pairs.size()},
         {"pairs", listed(scene.meshes[static_cast<std::size_t>(a.mesh)],
                          scene.meshes[static_cast<std::size_t>(b.mesh)], overlap.pairs)}});
  }
  return json{{"meshes", meshes}, {"instances", instances}}.dump(-1, ' ', false,
                                                                 json::error_handler_t::replace);
}

}  // namespace tessera::render
