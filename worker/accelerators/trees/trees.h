#pragma once

#include <memory>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::reference {

/// Trees, each in a file of its own that names its source. Each accepts one or more shapes, whatever
/// their boxes: flat, equal, overlapping.
std::unique_ptr<ShapeIndex> build_two_wide_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_skip_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_sphere_tree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_oriented_boxes(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_kd_tree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_polygon_bsp(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_octree(const ShapeBounds& shapes);

}  // namespace tessera::render::reference
