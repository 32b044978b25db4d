#pragma once

#include <memory>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

// Builders of grids; the .cpp file of each grid names its source. They require at least one shape;
// boxes may be flat, equal or overlapping.

std::unique_ptr<ShapeIndex> build_uniform_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_mailbox_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_recursive_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_hierarchical_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_proximity_grid(const ShapeBounds& shapes);

}  // namespace tessera::render::accelerators
