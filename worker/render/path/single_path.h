#pragma once

#include <optional>

#include "worker/geometry/ray.h"
#include "worker/math/vector.h"
#include "worker/render/path/path_tracer.h"
#include "worker/render/spots/light_spots.h"
#include "worker/sampling/sampler.h"

namespace tessera::render {

/// The start of one path.
struct PathStart {
  Sampler sampler;
  Ray ray;                     // from the camera
  const Hit* first = nullptr;  // hit of the ray, if known; an invalid triangle for a miss
  /// If not empty, light that delta lobes alone show to the camera is weighed, because a second
  /// path looks for it too.
  LightSpots::Pixel spots = {};
  Vec2f offset = {};  // of the ray from the pixel's centre, if there are spots
  /// Weight of the light that the camera ray itself finds, because a second path looks for it too.
  float direct_weight = 1;
  /// If set, this is that second path: it finds light by these lobes and nothing else.
  std::optional<LightSpots::Pixel::Second> second = {};
};

PathResult trace_path(const FrameContext& frame, const PathStart& start, PathScratch* scratch);

}  // namespace tessera::render
