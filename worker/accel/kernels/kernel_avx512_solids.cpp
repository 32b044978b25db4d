#include <immintrin.h>

#include <cmath>
#include <limits>

#include "worker/accel/kernels/kernels.h"
#include "worker/accel/layout/lanes.h"
#include "worker/geometry/object_ray.h"

// Only what follows may use AVX-512, not the inline functions of headers: the linker keeps one copy
// of those, and it must run everywhere.
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))), \
                             apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl")
#endif

namespace tessera::render::avx512 {
namespace {

#include "worker/accel/kernels/avx512_lanes.inc"
#include "worker/accel/kernels/solid_traversal.inc"

}  // namespace

bool closest_hit_with_solids(const SceneBvh<16>& trees, const Ray& ray, const HitFilter* filter,
                             Hit& hit) {
  return filter == nullptr ? find_closest_with_solids<false>(trees, ray, nullptr, hit)
                           : find_closest_with_solids<true>(trees, ray, filter, hit);
}
bool any_hit_with_solids(const SceneBvh<16>& trees, const Ray& ray, const HitFilter* filter) {
  return filter == nullptr ? find_any_with_solids<false>(trees, ray, nullptr)
                           : find_any_with_solids<true>(trees, ray, filter);
}

}  // namespace tessera::render::avx512

#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
