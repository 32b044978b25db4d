#include "worker/scene/solid_check.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/accel/mesh_overlap.h"

namespace tessera::render {
namespace {

using nlohmann::json;

/// Pairs that are listed of one mesh; all are counted.
constexpr std::size_t kMostListed = 100;

std::vector<bool> solid_primitives(const Scene& scene, const Mesh& mesh) {
  std::vector<bool> solid;
  for (const Primitive& p : mesh.primitives) {
    const Material& material = scene.materials[static_cast<std::size_t>(p.material)];
    solid.push_back(material.transmission > 0 && material.has_volume);
  }
  return solid;
}

json listed(const Mesh& a, const Mesh& b, const std::vector<OverlapPair>& pairs) {
  json list = json::array();
  for (std::size_t i = 0; i < std::min(pairs.size(), kMostListed); ++i) {
    list.push_back({a.primitives[pairs[i].a.primitive].id, pairs[i].a.triangle,
                    b.primitives[pairs[i].b.primitive].id, pairs[i].b.triangle});
  }
  return list;
}

json mesh_report(const Mesh& mesh) {
  const std::int64_t open = boundary_edges(mesh, std::vector<bool>(mesh.primitives.size(), true));
  const std::vector<OverlapPair> pairs = self_overlaps(mesh);
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
    const std::vector<bool> solid = solid_primitives(scene, mesh);
    if (std::find(solid.begin(), solid.end(), true) == solid.end()) continue;
    const auto warn = [&](const std::string& fault) {
      out.push_back({Problem::Severity::warning, absl::StrCat("mesh \"", mesh.name, "\""),
                     absl::StrCat("its material is a solid (it has a thickness), but ", fault)});
    };
    if (const std::int64_t open = boundary_edges(mesh, solid); open > 0) {
      warn(absl::StrCat("the surface is open at ", open,
                        " edges: light that enters it may not be seen to leave"));
    } else if (const auto pairs = self_overlaps(mesh, solid); !pairs.empty()) {
      warn(absl::StrCat("the surface meets itself at ", pairs.size(),
                        " pairs of triangles: what lies between them is inside twice"));
    }
  }
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
