#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "worker/scene/loader.h"
#include "worker/scene/pose_cache.h"

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
