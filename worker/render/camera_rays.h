#pragma once

#include <cstdint>

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A ray from the camera, worked out in double and rounded once.
struct CameraRay {
  Vec3f origin;     // on the near plane, recentred world
  Vec3f direction;  // unit
  float t_max = 0;  // to the far plane
};

/// Turns points of the film into rays. yfov or ymag is kept, the image's aspect ratio decides the
/// width; y of the film grows downwards, pixel (i, j) covers [i, i + 1) x [j, j + 1).
class CameraRays {
 public:
  CameraRays(const Camera& camera, std::int32_t width, std::int32_t height);

  /// The ray through film point (x, y), in pixels of the full frame.
  CameraRay ray(double x, double y) const;

  /// Distance of `p` (recentred world) along the viewing direction, metres.
  double depth(const Vec3f& p) const;

 private:
  Vec3d right_, up_, forward_, eye_;
  double pixel_ = 0;                 // world units per pixel, at unit distance if perspective
  double half_width_, half_height_;  // pixels
  double near_, far_;
  bool perspective_;
};

}  // namespace tessera::render
