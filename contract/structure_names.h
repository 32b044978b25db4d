#pragma once

#include <array>

namespace tessera::contract {

/// Values of --accelerator in client and worker, in the order of the table that `inspect
/// --accelerators` prints.
inline constexpr std::array kStructureNames = {
    "brute-force", "bvh2",   "bvh2-skip", "spheres",        "oriented-boxes",    "kd-tree",
    "polygon-bsp", "octree", "grid",      "recursive-grid", "hierarchical-grid", "proximity-grid"};

}  // namespace tessera::contract
