#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::reference {

/// Tests every shape.
std::unique_ptr<ShapeIndex> build_brute_force(const ShapeBounds& shapes);

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
