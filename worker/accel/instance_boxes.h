#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Where the instances of a scene are, for a structure over them.
struct InstanceBoxes {
  std::vector<std::uint32_t> instances;  // those that have something to hit; of the operands of a
                                         // CSG solid the first, for all
  std::vector<Box3f> boxes;              // of each, in the world, padded
  float origin_limit = 0;                // the pads hold for ray origins within this, per axis
};

/// `meshes` are the bounds of the scene's meshes, empty where nothing can be hit. A box is padded
/// so that no ray misses it that hits its mesh in object space; one placed by the identity needs no
/// pad, but for shapes, whose hits are not clamped to boxes.
InstanceBoxes place_instances(const Scene& scene, std::span<const Box3f> meshes);

}  // namespace tessera::render
