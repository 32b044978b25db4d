#pragma once

#include <cstdint>
#include <span>
#include <type_traits>

#include "worker/accel/layout/scene_bvh.h"
#include "worker/geometry/ray.h"

namespace tessera::render {

/// A call of a function object that outlives it: bool(const Hit&).
class HitFilter {
 public:
  template <typename Filter>
  explicit HitFilter(Filter& filter)
      : filter_(const_cast<void*>(static_cast<const void*>(&filter))),
        call_([](void* f, const Hit& hit) -> bool { return (*static_cast<Filter*>(f))(hit); }) {}

  bool operator()(const Hit& hit) const { return call_(filter_, hit); }

 private:
  void* filter_;
  bool (*call_)(void*, const Hit&);
};

/// Triangles of one mesh that a filtered any_hit surely shows once only, should spatial splits have
/// put them in several leaves: twice as many as may be transparent to one ray.
inline constexpr int kMaxShownOnce = 2048;

/// Rays that may be traced at one go.
inline constexpr int kPacketSize = 64;

/// The queries of SceneAccel, compiled twice from traversal.inc: with eight-wide nodes for AVX2,
/// and with sixteen-wide ones for AVX-512 (F, BW, DQ, VL). Rays must be valid. Hits do not depend
/// on which. Those with solids and those with motion are apart, so that nobody else pays; of the
/// latter, `filter` may be null. closest_hits and any_hits take up to kPacketSize rays and return a
/// bit for each that hits.
namespace avx2 {
bool closest_hit(const SceneBvh<8>& trees, const Ray& ray, Hit& hit);
bool closest_hit(const SceneBvh<8>& trees, const Ray& ray, const HitFilter& filter, Hit& hit);
bool any_hit(const SceneBvh<8>& trees, const Ray& ray);
bool any_hit(const SceneBvh<8>& trees, const Ray& ray, const HitFilter& filter);
std::uint64_t closest_hits(const SceneBvh<8>& trees, std::span<const Ray> rays, Hit* hits);
std::uint64_t any_hits(const SceneBvh<8>& trees, std::span<const Ray> rays);
bool closest_hit_with_solids(const SceneBvh<8>& trees, const Ray& ray, const HitFilter* filter,
                             Hit& hit);
bool any_hit_with_solids(const SceneBvh<8>& trees, const Ray& ray, const HitFilter* filter);
bool closest_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit);
bool any_hit_moving(const SceneBvh<8>& still, const MotionBvh<8>& moving, const Ray& ray,
                    const HitFilter* filter);
}  // namespace avx2

namespace avx512 {
bool closest_hit(const SceneBvh<16>& trees, const Ray& ray, Hit& hit);
bool closest_hit(const SceneBvh<16>& trees, const Ray& ray, const HitFilter& filter, Hit& hit);
bool any_hit(const SceneBvh<16>& trees, const Ray& ray);
bool any_hit(const SceneBvh<16>& trees, const Ray& ray, const HitFilter& filter);
std::uint64_t closest_hits(const SceneBvh<16>& trees, std::span<const Ray> rays, Hit* hits);
std::uint64_t any_hits(const SceneBvh<16>& trees, std::span<const Ray> rays);
bool closest_hit_with_solids(const SceneBvh<16>& trees, const Ray& ray, const HitFilter* filter,
                             Hit& hit);
bool any_hit_with_solids(const SceneBvh<16>& trees, const Ray& ray, const HitFilter* filter);
bool closest_hit_moving(const SceneBvh<16>& still, const MotionBvh<16>& moving, const Ray& ray,
                        const HitFilter* filter, Hit& hit);
bool any_hit_moving(const SceneBvh<16>& still, const MotionBvh<16>& moving, const Ray& ray,
                    const HitFilter* filter);
}  // namespace avx512

}  // namespace tessera::render
