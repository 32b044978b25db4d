#pragma once

#include <memory>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::reference {

/// Grids, each in a file of its own that names its source. Each accepts one or more shapes, whatever
/// their boxes: flat, equal, overlapping.
std::unique_ptr<ShapeIndex> build_uniform_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_recursive_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_hierarchical_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_proximity_grid(const ShapeBounds& shapes);

}  // namespace tessera::render::reference
