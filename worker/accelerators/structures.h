#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

/// An index that visits every shape.
std::unique_ptr<ShapeIndex> build_brute_force(const ShapeBounds& shapes);

/// An acceleration structure that can be selected by name.
struct Structure {
  std::string_view name;   // value of --accelerator
  std::string_view title;  // display name
  std::unique_ptr<ShapeIndex> (*build)(const ShapeBounds& shapes);
};

/// All structures, in the order in which reports list them.
std::span<const Structure> structures();

/// The structure with this name; null if there is none.
const Structure* find_structure(std::string_view name);

}  // namespace tessera::render::accelerators
