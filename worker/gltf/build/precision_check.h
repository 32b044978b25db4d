#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "worker/gltf/animation/pose_cache.h"
#include "worker/scene/problem.h"

namespace tessera::render {

/// The box of something that a node places, in world space.
struct PlacedBox {
  PosedBox box;
  std::int32_t node;
};

/// Warns of things so small and so far from `center` that floats, in which rays have their origins
/// relative to it, place them badly. One outlier is enough to move the middle of a scene.
std::optional<Problem> check_precision(std::span<const PlacedBox> placed, const Vec3d& center);

}  // namespace tessera::render
