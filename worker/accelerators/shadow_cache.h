#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/triangle.h"

namespace tessera::render {

/// Remembers, per light and depth, the triangle that stopped the last ray, and asks it first. It
/// changes no answer. Measured (docs/performance.md) and not used in production.
/// Source: E. Haines, D. Greenberg, "The light buffer: a shadow-testing accelerator", 1986 (its
/// cache of the last occluder).
class ShadowCache {
 public:
  /// Both must outlive the cache.
  ShadowCache(const Scene& scene, const SceneAccel& accel);

  /// Whether anything stops the ray; `light` and `depth` choose what is asked first.
  bool any_hit(const Ray& ray, std::uint32_t light, std::uint32_t depth);

  std::int64_t asked() const { return asked_; }
  std::int64_t saved() const { return saved_; }

 private:
  bool stops(const TriangleId& id, const Ray& ray) const;

  const Scene& scene_;
  const SceneAccel& accel_;
  std::vector<Box3f> bounds_;  // of each mesh: the slack of its rays depends on it
  std::array<TriangleId, 1024> last_{};
  std::int64_t asked_ = 0, saved_ = 0;
};

}  // namespace tessera::render
