#pragma once

#include <cstdint>
#include <span>

#include "worker/accel/layout/scene_bvh.h"
#include "worker/accel/traversal/hit_filter.h"
#include "worker/geometry/ray.h"

namespace tessera::render {

// The queries of SceneAccel, compiled from the same templates for AVX2, with nodes of eight
// children, and for AVX-512 (F, BW, DQ, VL), with nodes of sixteen. The hits are the same. Requires
// rays with t_max > 0. Scenes with solids and scenes with motion have functions of their own, so
// that other scenes do not pay for them; `filter` may be null in those. closest_hits and any_hits
// take up to kPacketSize rays, any t_max, and return one bit per ray that hits.

namespace avx2 {
bool closest_hit(const SceneBvh<8>& scene, const Ray& ray, Hit& hit);
bool closest_hit(const SceneBvh<8>& scene, const Ray& ray, const HitFilter& filter, Hit& hit);
bool any_hit(const SceneBvh<8>& scene, const Ray& ray);
bool any_hit(const SceneBvh<8>& scene, const Ray& ray, const HitFilter& filter);
std::uint64_t closest_hits(const SceneBvh<8>& scene, std::span<const Ray> rays, Hit* hits);
std::uint64_t any_hits(const SceneBvh<8>& scene, std::span<const Ray> rays);
bool closest_hit_with_solids(const SceneBvh<8>& scene, const Ray& ray, const HitFilter* filter,
                             Hit& hit);
bool any_hit_with_solids(const SceneBvh<8>& scene, const Ray& ray, const HitFilter* filter);
bool closest_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit);
bool any_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                    const HitFilter* filter);
// Queries of any scene that add their work to thread_traversal_counts(). Only for AVX2, so that
// counts do not depend on the processor.
bool closest_hit_counted(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                         const HitFilter* filter, Hit& hit);
bool any_hit_counted(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                     const HitFilter* filter);
}  // namespace avx2

namespace avx512 {
bool closest_hit(const SceneBvh<16>& scene, const Ray& ray, Hit& hit);
bool closest_hit(const SceneBvh<16>& scene, const Ray& ray, const HitFilter& filter, Hit& hit);
bool any_hit(const SceneBvh<16>& scene, const Ray& ray);
bool any_hit(const SceneBvh<16>& scene, const Ray& ray, const HitFilter& filter);
std::uint64_t closest_hits(const SceneBvh<16>& scene, std::span<const Ray> rays, Hit* hits);
std::uint64_t any_hits(const SceneBvh<16>& scene, std::span<const Ray> rays);
bool closest_hit_with_solids(const SceneBvh<16>& scene, const Ray& ray, const HitFilter* filter,
                             Hit& hit);
bool any_hit_with_solids(const SceneBvh<16>& scene, const Ray& ray, const HitFilter* filter);
bool closest_hit_moving(const SceneBvh<16>& still, const MotionBvh<16>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit);
bool any_hit_moving(const SceneBvh<16>& still, const MotionBvh<16>& moving, const Ray& ray,
                    const HitFilter* filter);
}  // namespace avx512

}  // namespace tessera::render
