#pragma once

#include <vector>

#include "worker/geometry/shape.h"
#include "worker/gltf/animation/pose_cache.h"
#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// The box, in object space, by which a shape counts for the bounds of the scene. A plane counts as
/// its origin, so that it changes neither the framed camera nor the precision of other objects.
PosedBox framing_box(const Shape& shape);

/// Returns a warning for each plane that emits light, because planes are not sampled as lights.
std::vector<Problem> emissive_plane_warnings(const Scene& scene);

}  // namespace tessera::render
