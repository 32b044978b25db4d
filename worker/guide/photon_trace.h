#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/guide/guide.h"
#include "worker/guide/photon.h"
#include "worker/guide/visible_region.h"
#include "worker/light/light_sampler.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// The scene and the settings with which the photons of a frame are traced.
struct PhotonScene {
  const Scene& scene;
  const ShadingScene& shading;
  const SceneAccel& accel;
  const LightSampler& lights;
  std::int32_t max_depth = 16;  // scattering events of a path
  std::uint32_t seed = 0;
  std::int32_t frame = 0;
  bool moves = false;  // something moves during the exposure
  /// Photons are kept only near places where paths along these rays scatter; all are kept if there
  /// are none. Unit directions.
  std::span<const Ray> camera_rays = {};
};

/// Emits photons number `first` to `first + count - 1`, and returns where they arrive in `region`,
/// in the order of their numbers, with a share of 0 or 1. Photon i is a function of the scene and i
/// alone.
///
/// Media do not affect photons, and BSDFs are sampled as if photons were paths from the camera: the
/// guide only has to be similar to the light.
std::vector<Photon> trace_photons(const PhotonScene& scene, const VisibleRegion& region,
                                  std::int64_t first, std::int64_t count,
                                  const ParallelFor& parallel_for);

/// Where the first scattering events of paths along the camera rays are, at most two of a path.
std::vector<SurfacePlace> seen_places(const PhotonScene& scene);

/// Builds the guide of a frame; null if the image gains little from one. The number of photons
/// depends on the scene: more are emitted while few arrive and guiding gains.
std::unique_ptr<const Guide> build_guide(const PhotonScene& scene, const ParallelFor& parallel_for);

}  // namespace tessera::render
