#pragma once

#include <array>
#include <vector>

#include "worker/light/light_sampler.h"
#include "worker/math/vector.h"
#include "worker/scene/scene.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// A part of a light that belongs together: connected triangles, a shape, or the sun of an
/// environment map.
struct SearchedLight {
  bool distant = false;
  Vec3d centre;                       // world; of a distant light: unit direction towards it
  std::array<Vec3d, 3> covariance{};  // of its points, square metres; of a distant light: of its
                                      // unit directions
  std::vector<Vec3d> corners;         // whose convex hull has nearly all of it; none if unknown
  double radius = 0;                  // around `centre`, metres; of a distant light: radians
  double radiance = 0;                // mean luminance
};

/// The lights that rays can hit, at the frame's time: the 256 of the greatest power, and the sun.
std::vector<SearchedLight> searched_lights(const Scene& scene, const ShadingScene& shading,
                                           const LightSampler& lights);

}  // namespace tessera::render
