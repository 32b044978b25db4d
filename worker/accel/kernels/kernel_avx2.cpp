#include "worker/accel/kernels/avx2.h"
#include "worker/accel/kernels/kernels.h"
#include "worker/accel/traversal/packet_traversal.h"

namespace tessera::render::avx2 {
namespace {

/// A type of this file alone gives the templates internal linkage, so that functions with one
/// caller are inlined.
struct LocalAvx2 : kernels::Avx2 {};

}  // namespace

bool closest_hit(const SceneBvh<8>& scene, const Ray& ray, Hit& hit) {
  return kernels::find_closest_hit<LocalAvx2, false>(scene, ray, nullptr, hit);
}
bool closest_hit(const SceneBvh<8>& scene, const Ray& ray, const HitFilter& filter, Hit& hit) {
  return kernels::find_closest_hit<LocalAvx2, true>(scene, ray, &filter, hit);
}
bool any_hit(const SceneBvh<8>& scene, const Ray& ray) {
  return kernels::find_any_hit<LocalAvx2, false>(scene, ray, nullptr);
}
bool any_hit(const SceneBvh<8>& scene, const Ray& ray, const HitFilter& filter) {
  return kernels::find_any_hit<LocalAvx2, true>(scene, ray, &filter);
}
std::uint64_t closest_hits(const SceneBvh<8>& scene, std::span<const Ray> rays, Hit* hits) {
  return kernels::find_closest_hits<LocalAvx2>(scene, rays, hits);
}
std::uint64_t any_hits(const SceneBvh<8>& scene, std::span<const Ray> rays) {
  return kernels::find_any_hits<LocalAvx2>(scene, rays);
}

}  // namespace tessera::render::avx2
