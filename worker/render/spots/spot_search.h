#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/spots/convex_polygon.h"
#include "worker/render/spots/searched_lights.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// Where a light appears in the picture, about.
struct LightSpot {
  std::vector<Vec2d> outline;  // convex polygon (convex_polygon.h), pixels of the full frame
  std::uint64_t lobes = 1;     // on the way to the light (with_lobe())
  float brightness = 0;        // luminance of the image
  float probability = 1;       // with which sampling chooses these lobes

  double area() const { return area_of(outline); }  // square pixels
};

/// Scene, camera and limits of a search for spots. The camera must not move or use a lens.
struct SpotSearch {
  const ShadingScene& shading;
  const SceneAccel& accel;
  const CameraRays& camera;
  std::int32_t width = 0, height = 0;  // of the full frame
  std::int32_t max_depth = 16;
  double margin = 0;  // around the frame, pixels
};

/// Finds images of the lights: those that the camera sees directly, and those with a centre that
/// camera rays in a grid surround, which is divided where rays of neighbours differ.
std::vector<LightSpot> find_spots(const SpotSearch& search, std::span<const SearchedLight> lights,
                                  const ParallelFor& parallel_for);

}  // namespace tessera::render
