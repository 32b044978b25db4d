#pragma once

#include <vector>

#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Warns of each punctual light that reaches surfaces only through solid glass. Next-event
/// estimation cannot see it there, and no path hits a point: such a room stays dark. Judged by
/// segments from at most 64 triangles' centres to the light; costs their number times the
/// instanced triangles, and nothing without both such materials and such lights.
std::vector<Problem> check_light_through_glass(const Scene& scene);

}  // namespace tessera::render
