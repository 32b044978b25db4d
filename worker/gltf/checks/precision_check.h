#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "worker/gltf/animation/pose_cache.h"
#include "worker/scene/problem.h"

namespace tessera::render {

/// World-space bounding box of an object that a node places.
struct PlacedBox {
  PosedBox box;
  std::int32_t node;
};

/// Warns of objects so small and so far from `center` that single-precision rays, whose origins are
/// relative to it, place them inaccurately. One distant object is enough to move the centre.
std::optional<Problem> check_precision(std::span<const PlacedBox> placed, const Vec3d& center);

}  // namespace tessera::render
