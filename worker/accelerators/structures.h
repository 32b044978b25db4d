#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

/// Builds an index that visits every shape.
std::unique_ptr<ShapeIndex> build_brute_force(const ShapeBounds& shapes);

/// An acceleration structure that can be selected by name.
struct Structure {
  std::string_view name;   // value of --accelerator
  std::string_view title;  // display name
  std::unique_ptr<ShapeIndex> (*build)(const ShapeBounds& shapes);
  bool takes_rays = false;  // the build depends on ShapeBounds::rays
};

/// Returns all structures, in the order of reports.
std::span<const Structure> structures();

/// Returns the structure with this name, or null if there is none.
const Structure* find_structure(std::string_view name);

}  // namespace tessera::render::accelerators
