#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/render/spots/small_lights.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// Where a light appears in the picture: about the ellipse of the points
/// (x + a q.x, y + b q.x + c q.y) with |q| <= 1.
struct LightSpot {
  double x = 0, y = 0;         // centre, pixels of the full frame
  double a = 0, b = 0, c = 0;  // pixels
  std::uint64_t lobes = 1;     // on the way to the light (with_lobe())
  float brightness = 0;        // luminance of the image
  float probability = 1;       // with which sampling chooses these lobes

  double area() const;  // of the ellipse, square pixels
};

/// Scene, camera and limits of a search for spots. The camera must not move or use a lens.
struct SpotSearch {
  const ShadingScene& shading;
  const SceneAccel& accel;
  const CameraRays& camera;
  std::int32_t width = 0, height = 0;  // of the full frame
  std::int32_t max_depth = 16;
  double margin = 0;      // around the frame, pixels
  double pixel_area = 1;  // over which the pixel filter spreads samples, square pixels
};

/// Finds images of the lights that few samples of a pixel find: less than a quarter, because the
/// images are small or because sampling rarely chooses the lobes on the way. The images are those
/// that camera rays in a grid surround, which is divided where rays of neighbours differ.
std::vector<LightSpot> find_spots(const SpotSearch& search, std::span<const SmallLight> lights,
                                  const ParallelFor& parallel_for);

}  // namespace tessera::render
