#pragma once

#include <string>
#include <vector>

#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Warns of each mesh that a solid (transmission with a thickness) is made of though its surface is
/// open or meets itself: what is inside is then not known everywhere. Costs nothing without such
/// materials.
std::vector<Problem> check_solids(const Scene& scene);

/// What of the scene overlaps, as JSON: the member "self_intersections" of tessera.inspect/1.
/// Meshes are looked at in object space, exactly; instances against each other by their corners in
/// the world, rounded to float.
std::string overlap_report(const Scene& scene);

}  // namespace tessera::render
