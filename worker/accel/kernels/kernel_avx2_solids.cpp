#include <immintrin.h>

#include <cmath>
#include <limits>

#include "worker/accel/kernels/kernels.h"
#include "worker/accel/layout/lanes.h"
#include "worker/geometry/object_ray.h"

namespace tessera::render::avx2 {
namespace {

#include "worker/accel/kernels/avx2_lanes.inc"
#include "worker/accel/kernels/solid_traversal.inc"

}  // namespace

bool closest_hit_with_solids(const SceneBvh<8>& trees, const Ray& ray, const HitFilter* filter,
                             Hit& hit) {
  return filter == nullptr ? find_closest_with_solids<false>(trees, ray, nullptr, hit)
                           : find_closest_with_solids<true>(trees, ray, filter, hit);
}
bool any_hit_with_solids(const SceneBvh<8>& trees, const Ray& ray, const HitFilter* filter) {
  return filter == nullptr ? find_any_with_solids<false>(trees, ray, nullptr)
                           : find_any_with_solids<true>(trees, ray, filter);
}

}  // namespace tessera::render::avx2
