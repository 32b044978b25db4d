#include "worker/accel/kernels/avx512.h"
#include "worker/accel/kernels/kernels.h"

TESSERA_BEGIN_AVX512

#include "worker/accel/traversal/motion_traversal.h"

namespace tessera::render::avx512 {
namespace {

/// A type of this file alone gives the templates internal linkage: functions with one caller are
/// inlined, and no symbol compiled for AVX-512 is shared with another file.
struct LocalAvx512 : kernels::Avx512 {};

}  // namespace

bool closest_hit_moving(const SceneBvh<16>& still, const MotionBvh<16>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit) {
  return filter == nullptr
             ? kernels::find_closest_hit_moving<LocalAvx512, false>(still, moving, ray, nullptr,
                                                                    hit)
             : kernels::find_closest_hit_moving<LocalAvx512, true>(still, moving, ray, filter, hit);
}
bool any_hit_moving(const SceneBvh<16>& still, const MotionBvh<16>& moving, const Ray& ray,
                    const HitFilter* filter) {
  return filter == nullptr
             ? kernels::find_any_hit_moving<LocalAvx512, false>(still, moving, ray, nullptr)
             : kernels::find_any_hit_moving<LocalAvx512, true>(still, moving, ray, filter);
}

}  // namespace tessera::render::avx512

TESSERA_END_AVX512
