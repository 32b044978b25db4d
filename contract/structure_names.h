#pragma once

#include <array>

namespace tessera::contract {

/// Values of --accelerator in client and worker, in the order of the table that `inspect
/// --accelerators` prints.
inline constexpr std::array kStructureNames = {
    "brute-force",       "bvh2",           "rdh-bvh",  "bvh2-skip",      "bvh2-parents",
    "spheres",           "oriented-boxes", "axis-bsp", "kd-tree",        "polygon-bsp",
    "polygon-bsp-split", "octree",         "grid",     "grid-mailboxes", "recursive-grid",
    "hierarchical-grid", "proximity-grid"};

}  // namespace tessera::contract
