#pragma once

#include "worker/geometry/bounds.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Box around all triangles and shapes at the frame's time, recentred: of the transformed vertices,
/// not of transformed boxes, and of support() for shapes. Operands of solids count as a whole.
/// Empty if the scene has neither. Costs a transform of each vertex of the outermost instances.
Box3d visible_bounds(const Scene& scene);

}  // namespace tessera::render
