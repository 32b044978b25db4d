#pragma once

#include <cstddef>

#include "worker/accel/traversal/hit_filter.h"
#include "worker/geometry/ray.h"

namespace tessera::render {

/// Ray-query interface of SceneAccel, also implemented by the structures of worker/accelerators and
/// by record_rays(). Queries behave like those of SceneAccel; `filter` may be null. Requires
/// t_max > 0.
class Accelerator {
 public:
  virtual ~Accelerator() = default;
  virtual bool closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const = 0;
  virtual bool any_hit(const Ray& ray, const HitFilter* filter) const = 0;
  virtual std::size_t memory_bytes() const = 0;
};

}  // namespace tessera::render
