#include <immintrin.h>

#include <cmath>
#include <limits>

#include "worker/accel/kernels/kernels.h"
#include "worker/accel/layout/lanes.h"
#include "worker/geometry/object_ray.h"

namespace tessera::render::avx2 {
namespace {

#include "worker/accel/kernels/avx2_lanes.inc"
#include "worker/accel/kernels/packet.inc"

}  // namespace

bool closest_hit(const SceneBvh<8>& trees, const Ray& ray, Hit& hit) {
  return find_closest<false>(trees, ray, nullptr, hit);
}
bool closest_hit(const SceneBvh<8>& trees, const Ray& ray, const HitFilter& filter, Hit& hit) {
  return find_closest<true>(trees, ray, &filter, hit);
}
bool any_hit(const SceneBvh<8>& trees, const Ray& ray) {
  return find_any<false>(trees, ray, nullptr);
}
bool any_hit(const SceneBvh<8>& trees, const Ray& ray, const HitFilter& filter) {
  return find_any<true>(trees, ray, &filter);
}
std::uint64_t closest_hits(const SceneBvh<8>& trees, std::span<const Ray> rays, Hit* hits) {
  return find_closest_of(trees, rays, hits);
}
std::uint64_t any_hits(const SceneBvh<8>& trees, std::span<const Ray> rays) {
  return find_any_of(trees, rays);
}

}  // namespace tessera::render::avx2
