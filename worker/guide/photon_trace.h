#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/guide/guide.h"
#include "worker/guide/photon.h"
#include "worker/guide/photon_path.h"
#include "worker/guide/visible_region.h"

namespace tessera::render {

/// Emits photons number `first` to `first + count - 1`, and returns where they arrive in `region`,
/// in the order of their numbers, with a share of 0 or 1. Photon i is a function of the scene and i
/// alone.
std::vector<Photon> trace_photons(const PhotonScene& scene, const VisibleRegion& region,
                                  std::int64_t first, std::int64_t count,
                                  const ParallelFor& parallel_for);

/// Where the first scattering events of paths along the camera rays are, at most two of a path.
std::vector<SurfacePlace> seen_places(const PhotonScene& scene);

/// Builds the guide of a frame; null if the image gains little from one. The number of photons
/// depends on the scene: more are emitted while few arrive and guiding gains.
std::unique_ptr<const Guide> build_guide(const PhotonScene& scene, const ParallelFor& parallel_for);

}  // namespace tessera::render
