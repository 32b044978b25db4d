#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "worker/accel/reference/shapes.h"

namespace tessera::render::reference {

/// The structures, each in a file of its own that names its source. All may be built over any
/// number of shapes from one on, whatever their boxes: flat, equal, overlapping.
std::unique_ptr<ShapeIndex> build_brute_force(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_two_wide_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_skip_bvh(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_sphere_tree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_oriented_boxes(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_kd_tree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_polygon_bsp(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_octree(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_uniform_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_recursive_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_hierarchical_grid(const ShapeBounds& shapes);
std::unique_ptr<ShapeIndex> build_proximity_grid(const ShapeBounds& shapes);

struct Structure {
  std::string_view name;   // as --accelerator takes it
  std::string_view title;  // for people
  std::unique_ptr<ShapeIndex> (*build)(const ShapeBounds& shapes);
};

/// All of them, in the order of the table.
std::span<const Structure> structures();

/// The one of that name; null if there is none.
const Structure* find_structure(std::string_view name);

}  // namespace tessera::render::reference
