#include "worker/accelerators/structures.h"

#include <algorithm>
#include <iterator>

#include "contract/structure_names.h"
#include "worker/accelerators/grids/grids.h"
#include "worker/accelerators/trees/trees.h"

namespace tessera::render::accelerators {

std::span<const Structure> structures() {
  static constexpr Structure kStructures[] = {
      {"brute-force", "brute force", build_brute_force},
      {"bvh2", "two-wide BVH, recursive", build_two_wide_bvh},
      {"rdh-bvh", "two-wide BVH, guided by rays", build_rdh_bvh, true},
      {"bvh2-skip", "two-wide BVH, skip pointers", build_skip_bvh},
      {"bvh2-parents", "two-wide BVH, parent pointers", build_parent_bvh},
      {"spheres", "bounding spheres", build_sphere_tree},
      {"oriented-boxes", "oriented boxes", build_oriented_boxes},
      {"axis-bsp", "axis-aligned BSP", build_axis_bsp},
      {"kd-tree", "kd-tree", build_kd_tree},
      {"polygon-bsp", "polygon-aligned BSP", build_polygon_bsp},
      {"polygon-bsp-split", "polygon BSP, splitting", build_splitting_bsp},
      {"octree", "octree", build_octree},
      {"grid", "uniform grid", build_uniform_grid},
      {"grid-mailboxes", "uniform grid, mailboxes", build_mailbox_grid},
      {"recursive-grid", "recursive grid", build_recursive_grid},
      {"hierarchical-grid", "one grid per size", build_hierarchical_grid},
      {"proximity-grid", "grid, proximity clouds", build_proximity_grid},
  };
  static_assert(std::equal(std::begin(kStructures), std::end(kStructures),
                           contract::kStructureNames.begin(), contract::kStructureNames.end(),
                           [](const Structure& a, std::string_view b) { return a.name == b; }));
  return kStructures;
}

const Structure* find_structure(std::string_view name) {
  for (const Structure& structure : structures()) {
    if (structure.name == name) return &structure;
  }
  return nullptr;
}

}  // namespace tessera::render::accelerators
