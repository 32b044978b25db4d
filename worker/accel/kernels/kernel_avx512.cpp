#include "worker/accel/kernels/avx512.h"
#include "worker/accel/kernels/kernels.h"

TESSERA_BEGIN_AVX512

#include "worker/accel/traversal/packet_traversal.h"

namespace tessera::render::avx512 {
namespace {

/// A type of this file alone gives the templates internal linkage: functions with one caller are
/// inlined, and no symbol compiled for AVX-512 is shared with another file.
struct LocalAvx512 : kernels::Avx512 {};

}  // namespace

bool closest_hit(const SceneBvh<16>& scene, const Ray& ray, Hit& hit) {
  return kernels::find_closest_hit<LocalAvx512, false>(scene, ray, nullptr, hit);
}
bool closest_hit(const SceneBvh<16>& scene, const Ray& ray, const HitFilter& filter, Hit& hit) {
  return kernels::find_closest_hit<LocalAvx512, true>(scene, ray, &filter, hit);
}
bool any_hit(const SceneBvh<16>& scene, const Ray& ray) {
  return kernels::find_any_hit<LocalAvx512, false>(scene, ray, nullptr);
}
bool any_hit(const SceneBvh<16>& scene, const Ray& ray, const HitFilter& filter) {
  return kernels::find_any_hit<LocalAvx512, true>(scene, ray, &filter);
}
std::uint64_t closest_hits(const SceneBvh<16>& scene, std::span<const Ray> rays, Hit* hits) {
  return kernels::find_closest_hits<LocalAvx512>(scene, rays, hits);
}
std::uint64_t any_hits(const SceneBvh<16>& scene, std::span<const Ray> rays) {
  return kernels::find_any_hits<LocalAvx512>(scene, rays);
}

}  // namespace tessera::render::avx512

TESSERA_END_AVX512
