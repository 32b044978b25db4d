#pragma once

#include <cstdint>
#include <memory>

#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accelerators/shapes/shapes.h"

namespace tessera::render::accelerators {

/// Maximum number of shapes in a leaf.
inline constexpr std::uint32_t kTwoWideLeafSize = 4;

/// Traverses a tree over shapes recursively, the nearer child first. Requires at least one node.
std::unique_ptr<ShapeIndex> make_two_wide_bvh(BinaryBvh bvh);

}  // namespace tessera::render::accelerators
