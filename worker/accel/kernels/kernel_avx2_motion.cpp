#include "worker/accel/kernels/avx2.h"
#include "worker/accel/kernels/kernels.h"
#include "worker/accel/traversal/motion_traversal.h"

namespace tessera::render::avx2 {
namespace {

/// A type of this file alone gives the templates internal linkage, so that functions with one
/// caller are inlined.
struct LocalAvx2 : kernels::Avx2 {};

}  // namespace

bool closest_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit) {
  return filter == nullptr
             ? kernels::find_closest_hit_moving<LocalAvx2, false>(still, moving, ray, nullptr, hit)
             : kernels::find_closest_hit_moving<LocalAvx2, true>(still, moving, ray, filter, hit);
}
bool any_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                    const HitFilter* filter) {
  return filter == nullptr
             ? kernels::find_any_hit_moving<LocalAvx2, false>(still, moving, ray, nullptr)
             : kernels::find_any_hit_moving<LocalAvx2, true>(still, moving, ray, filter);
}

}  // namespace tessera::render::avx2
