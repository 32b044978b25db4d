#include "worker/accelerators/shapes/shapes.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tessera::render::accelerators {

bool make_shape_ray(const Vec3f& origin, const Vec3f& direction, const Box3f& all, ShapeRay& ray) {
  if (!make_object_ray(origin, direction, all, ray.slabs)) return false;
  ray.origin = Vec3d(origin);
  ray.direction = ray.box_direction = Vec3d(direction);
  double reach = 0, steepest = 0;
  for (int k = 0; k < 3; ++k) {
    const double o = ray.origin[k];
    const auto lo = static_cast<double>(all.lo[k]), hi = static_cast<double>(all.hi[k]);
    reach = std::max({reach, std::fabs(lo - o), std::fabs(hi - o)});
    if (std::isinf(ray.slabs.inverse[k])) {
      ray.box_direction[k] = 0;
    } else {
      steepest = std::max(steepest, std::fabs(static_cast<double>(ray.slabs.inverse[k])));
    }
  }
  ray.hit_tolerance = kHitTolerance * reach;
  ray.hull_slack = ray.hit_tolerance * steepest;
  return true;
}

std::vector<std::uint32_t> all_shapes(std::uint32_t count) {
  std::vector<std::uint32_t> all(count);
  std::iota(all.begin(), all.end(), 0u);
  return all;
}

}  // namespace tessera::render::accelerators
