#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/geometry/ray.h"
#include "worker/render/camera/camera_rays.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Finds where surfaces were in the image one frame earlier, and will be one frame later. Follows
/// instances, the vertices of meshes that deform, and the camera.
class MotionVectors {
 public:
  /// The size is that of the full frame. Requires scene.before and scene.after. `scene` must
  /// outlive this.
  MotionVectors(const Scene& scene, std::int32_t width, std::int32_t height);

  /// Pixels to the right and up from where the point of the surface is at the frame's time to where
  /// it is one frame earlier, and one frame later. 0 where the camera does not see the point, or
  /// its instance does not exist.
  std::array<float, 4> of(const Hit& hit) const;

 private:
  /// The scene at one time.
  struct Moment {
    const Scene& scene;
    CameraRays camera;
    std::vector<std::int32_t> instances;  // by instance of the frame's scene; kNone: absent
  };

  Moment moment(const Scene& scene, std::int32_t width, std::int32_t height) const;

  const Scene& scene_;
  const Moment now_, before_, after_;
};

}  // namespace tessera::render
