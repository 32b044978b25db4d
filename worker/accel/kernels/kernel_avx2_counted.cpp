#include "worker/accel/kernels/avx2.h"
#include "worker/accel/kernels/kernels.h"
#include "worker/accel/traversal/counted_queries.h"

namespace tessera::render::avx2 {
namespace {

/// A type of this file alone gives the templates internal linkage, so that functions with one
/// caller are inlined.
struct LocalAvx2 : kernels::Avx2 {};

constexpr auto kAcceptAll = [](const Hit&) { return true; };

}  // namespace

bool closest_hit_counted(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                         const HitFilter* filter, Hit& hit) {
  const HitFilter all(kAcceptAll);
  kernels::Moving<kernels::Counted<kernels::ClosestHitWithSolids<LocalAvx2, true>>> query(
      ray, filter == nullptr ? &all : filter);
  kernels::intersect_counted(still, moving, ray, query);
  return query.result(hit);
}

bool any_hit_counted(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                     const HitFilter* filter) {
  const HitFilter all(kAcceptAll);
  kernels::Moving<kernels::Counted<kernels::AnyHitWithSolids<LocalAvx2, true>>> query(
      ray, filter == nullptr ? &all : filter);
  return kernels::intersect_counted(still, moving, ray, query);
}

}  // namespace tessera::render::avx2
