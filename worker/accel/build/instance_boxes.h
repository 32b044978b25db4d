#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// World-space boxes of a scene's instances, over which an acceleration structure is built.
struct InstanceBoxes {
  std::vector<std::uint32_t> instances;  // those that can be hit; a CSG solid is represented by its
                                         // first operand
  std::vector<Box3f> boxes;              // by element of `instances`, padded
  std::vector<std::uint32_t> unbounded;  // further instances that can be hit: planes, and solids as
                                         // large as a plane, which no tree helps to find
  float origin_limit = 0;                // the padding covers ray origins up to this size, per axis
};

/// Selects instances by their motion.
struct InstanceSelection {
  bool still = true;                     // those that do not move during the exposure
  std::optional<std::uint32_t> segment;  // those that move, from this keyframe to the next
};

/// Computes the boxes of the selected instances. `meshes` are the object-space bounds of the
/// scene's meshes during the selected interval, empty for those that cannot be hit. Boxes are
/// padded so that every ray that hits a mesh in object space meets its box. A mesh with the
/// identity as its transform needs no padding, unlike a shape, whose hits are not clamped to a box.
///
/// `parts`, if given: for each mesh, smaller boxes that together contain all its triangles, or
/// none. The box of a rotated instance then encloses its rotated parts, and is smaller than one
/// that encloses the rotated box of the mesh.
InstanceBoxes bound_instances(const Scene& scene, std::span<const Box3f> meshes,
                              const InstanceSelection& choice = {},
                              std::span<const std::vector<Box3f>> parts = {});

/// Returns for each instance whether it, its mesh or an operand of its CSG solid moves during the
/// exposure.
std::vector<bool> moving_instances(const Scene& scene);

}  // namespace tessera::render
