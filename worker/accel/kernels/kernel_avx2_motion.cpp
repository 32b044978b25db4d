#include <immintrin.h>

#include <cmath>
#include <limits>

#include "worker/accel/kernels/kernels.h"
#include "worker/accel/layout/lanes.h"
#include "worker/geometry/motion.h"
#include "worker/geometry/object_ray.h"

namespace tessera::render::avx2 {
namespace {

#include "worker/accel/kernels/avx2_lanes.inc"
#include "worker/accel/kernels/motion_traversal.inc"

}  // namespace

bool closest_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit) {
  return filter == nullptr ? find_closest_moving<false>(still, moving, ray, nullptr, hit)
                           : find_closest_moving<true>(still, moving, ray, filter, hit);
}
bool any_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                    const HitFilter* filter) {
  return filter == nullptr ? find_any_moving<false>(still, moving, ray, nullptr)
                           : find_any_moving<true>(still, moving, ray, filter);
}

}  // namespace tessera::render::avx2
