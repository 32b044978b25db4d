#pragma once

#include <vector>

#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Warns of punctual lights that reach surfaces only through solid glass. Shadow rays cannot pass a
/// refracting surface and BSDF sampling cannot hit a point, so such lights contribute nothing.
/// Tests segments from the centres of at most 64 triangles to each light; the cost is proportional
/// to that times the number of instanced triangles, and zero without solid glass or punctual
/// lights.
std::vector<Problem> check_light_through_glass(const Scene& scene);

}  // namespace tessera::render
