#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>

#include "contract/render_settings.h"
#include "contract/traversal_counts.h"
#include "worker/accel/scene_accel.h"
#include "worker/light/light_sampler.h"
#include "worker/math/vector.h"
#include "worker/media/media.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/path/path_observer.h"
#include "worker/render/path/transparency.h"
#include "worker/sampling/pixel_filter.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

class Guide;
class LensSpots;
class LightSpots;
class MotionVectors;

/// Data shared by all paths of a frame. Immutable while paths are traced.
struct FrameContext {
  const ShadingScene& shading;
  const SceneAccel& accel;
  const LightSampler& lights;
  const CameraRays& camera;
  const PixelFilterSampler& filter;
  contract::Background background = contract::Background::automatic;
  Vec3f background_color;
  std::int32_t max_depth = 16;
  bool cull_backfaces = false;
  std::uint32_t seed = 0;
  std::int32_t frame = 0;
  std::uint32_t aovs = 0;                 // contract::Aov bits
  bool moves = false;                     // something moves during the exposure: rays have times
  const Guide* guide = nullptr;           // directions of light for --guiding; may be null
  const LightSpots* spots = nullptr;      // images of lights; may be null
  const LensSpots* lens_spots = nullptr;  // lights out of focus; may be null
  const MotionVectors* motion = nullptr;  // null unless the motion layer is requested
};

/// Memory of a thread for tracing paths, so that no path allocates.
struct PathScratch {
  ThinSurfaceStack thin_surfaces;
  std::unique_ptr<Crossings> crossings;  // allocated for the first path that tracks bodies
  MovedSurface met, passed;              // surfaces where the path is, and where a ray of it passes
  PathObserver* observer = nullptr;      // receives the events of paths, for debugging; may be null
};

/// The first surface that a camera path hits.
struct CameraHit {
  bool present = false;
  Vec3f albedo;    // base colour
  Vec3f normal;    // shading normal on the viewer's side; zero unless a layer needs it
  Vec3f position;  // recentred world
  std::int32_t node = 0, material = 0, primitive = 0;
  float time = 0;   // of the ray that met it
  float depth = 0;  // along the view axis; zero unless the denoising layer is requested
  std::array<float, 4> motion{};  // as FilmBlock::motion; zero unless requested
};

/// One sample of a pixel.
struct PathResult {
  Vec3f radiance;
  float alpha = 1;
  CameraHit hit;
  std::int32_t limit_count = 0;  // how often kTransparencyLimit was exceeded
  /// Radiance beyond max_depth, weighted for the paths it represents; not in `radiance`.
  Vec3f truncated;
  contract::TraversalCounts cost;  // of all its rays; zero unless its layer is requested
};

/// Identifies a path: a sample of a pixel, in full-frame coordinates.
struct PathId {
  std::int32_t x = 0, y = 0, sample = 0;
};

/// Traces up to kPacketSize paths; results[i] is a function of the frame and ids[i] alone. Camera
/// rays of neighbouring pixels are faster together. The radiance may be non-finite: the film drops
/// such samples.
void trace_paths(const FrameContext& frame, std::span<const PathId> ids, PathScratch* scratch,
                 PathResult* results);

}  // namespace tessera::render
