#include "worker/accel/kernels/avx2.h"
#include "worker/accel/kernels/kernels.h"
#include "worker/accel/traversal/solid_traversal.h"

namespace tessera::render::avx2 {
namespace {

/// A type of this file alone gives the templates internal linkage, so that functions with one
/// caller are inlined.
struct LocalAvx2 : kernels::Avx2 {};

}  // namespace

bool closest_hit_with_solids(const SceneBvh<8>& scene, const Ray& ray, const HitFilter* filter,
                             Hit& hit) {
  return filter == nullptr
             ? kernels::find_closest_hit_with_solids<LocalAvx2, false>(scene, ray, nullptr, hit)
             : kernels::find_closest_hit_with_solids<LocalAvx2, true>(scene, ray, filter, hit);
}
bool any_hit_with_solids(const SceneBvh<8>& scene, const Ray& ray, const HitFilter* filter) {
  return filter == nullptr
             ? kernels::find_any_hit_with_solids<LocalAvx2, false>(scene, ray, nullptr)
             : kernels::find_any_hit_with_solids<LocalAvx2, true>(scene, ray, filter);
}

}  // namespace tessera::render::avx2
