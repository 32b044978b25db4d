#pragma once

#include <memory>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

// Builders of trees; the .cpp file of each tree names its source. They require at least one shape;
// boxes may be flat, equal or overlapping.

std::unique_ptr<ShapeIndex> build_two_wide_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_rdh_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_skip_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_parent_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_sphere_tree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_oriented_boxes(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_axis_bsp(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_kd_tree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_polygon_bsp(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_splitting_bsp(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_octree(const ShapeBounds& shapes);

}  // namespace tessera::render::accelerators
