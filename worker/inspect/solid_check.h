#pragma once

#include <string>
#include <vector>

#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Warns of meshes of solids (transmission with thickness) with an open or self-intersecting
/// surface, where the inside is not defined everywhere. Costs nothing without such materials.
std::vector<Problem> check_solids(const Scene& scene);

/// Self-intersections of the scene as JSON: the member "self_intersections" of tessera.inspect/1.
/// Meshes are tested exactly in object space, instances against each other by their world-space
/// vertices rounded to float.
std::string overlap_report(const Scene& scene);

}  // namespace tessera::render
