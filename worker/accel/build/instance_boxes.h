#pragma once

#include <cstdint>
#include <optional>
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

/// Which instances are wanted.
struct InstanceChoice {
  bool still = true;                     // those that do not move while the shutter is open
  std::optional<std::uint32_t> segment;  // those that do, from this key to the next
};

/// `meshes` are the bounds of the scene's meshes, empty where nothing can be hit; of those that are
/// wanted, from the key to the next. A box is padded so that no ray misses it that hits its mesh in
/// object space; one placed by the identity needs no pad, but for shapes, whose hits are not
/// clamped to boxes.
InstanceBoxes place_instances(const Scene& scene, std::span<const Box3f> meshes,
                              const InstanceChoice& choice = {});

/// By instance: whether it, its mesh, or an operand of its CSG solid moves while the shutter is
/// open.
std::vector<bool> moving_instances(const Scene& scene);

}  // namespace tessera::render
