#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A sample of a pixel.
struct DebugPixelRequest {
  std::int32_t x = 0, y = 0;  // in the full frame
  std::int32_t sample = 0;
  std::int32_t frame = 0;
};

/// Traces one sample of `scene`, posed at the request's frame, and describes its path as text: for
/// each vertex the hit, the BSDF, the throughput, the radiance gained with its MIS weight, media
/// and Russian roulette; last the sample's radiance, exactly as render() adds it.
///
/// Errors: InvalidArgument, the pixel is outside the frame, or the settings cannot be rendered.
absl::StatusOr<std::string> debug_pixel(const Scene& scene,
                                        const contract::RenderSettings& settings,
                                        const DebugPixelRequest& request);

}  // namespace tessera::render
