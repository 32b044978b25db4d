#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// A shadow ray with the keys of a shadow cache.
struct ShadowRay {
  Ray ray;
  std::uint32_t depth = 0;  // scattering events before it
  std::uint32_t light = 0;  // identifies its end point, or its direction if it has none
};

/// Rays of an image in tracing order.
struct RecordedRays {
  std::vector<Ray> camera, bounces;
  std::vector<ShadowRay> shadows;
  std::vector<Ray> visible;  // camera and bounces, t_max at the hit: how far they were traced
};

/// Renders the frame's first sample at 128 pixels across and returns the rays of paths of at most
/// three scattering events. The result is a function of the scene and the settings.
/// Errors: InvalidArgument if the scene or the settings cannot be rendered.
absl::StatusOr<RecordedRays> record_rays(const Scene& scene, contract::RenderSettings settings);

}  // namespace tessera::render
