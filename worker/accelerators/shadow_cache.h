#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/triangle.h"

namespace tessera::render {

/// Remembers the last occluder per light and depth and tests it first, which does not change
/// results. Renders do not use it; docs/notes/accelerators-compared.md has the measurements.
/// Source: E. Haines, D. Greenberg, "The light buffer: a shadow-testing accelerator", 1986 (its
/// cache of the last occluder).
class ShadowCache {
 public:
  /// `scene` and `accel` must outlive the cache.
  ShadowCache(const Scene& scene, const SceneAccel& accel);

  /// Returns whether anything occludes the ray; `light` and `depth` select the cache entry.
  ///
  /// `occluder` is what find_occluder() returns for the ray. A renderer would have to learn it from
  /// the query; here it costs nothing, so that a comparison shows the cache at its best.
  bool any_hit(const Ray& ray, std::uint32_t light, std::uint32_t depth,
               const TriangleId& occluder);

  /// Returns the occluder that SceneAccel::any_hit() meets first, if a cache can hold it: a
  /// triangle that does not move. Otherwise a default TriangleId.
  TriangleId find_occluder(const Ray& ray) const;

 private:
  bool occludes(const TriangleId& id, const Ray& ray) const;

  const Scene& scene_;
  const SceneAccel& accel_;
  std::vector<Box3f> bounds_;  // by mesh; make_object_ray() needs them
  std::array<TriangleId, 1024> last_{};
};

}  // namespace tessera::render
