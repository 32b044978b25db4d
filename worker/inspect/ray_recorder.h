#pragma once

#include <cstdint>
#include <vector>

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// A shadow ray with the keys of a shadow cache.
struct ShadowRay {
  Ray ray;
  std::uint32_t depth = 0;  // scattering events before it
  std::uint32_t light = 0;  // identifies its end point, or its direction if it has none
};

/// Rays of an image in tracing order.
struct RecordedRays {
  std::vector<Ray> camera, bounces;
  std::vector<ShadowRay> shadows;
};

/// Answers as SceneAccel does and records all queries. Not thread-safe.
class RayRecorder final : public Accelerator {
 public:
  /// `rays` must outlive the recorder.
  RayRecorder(const Scene& scene, RecordedRays* rays);

  bool closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const override;
  bool any_hit(const Ray& ray, const HitFilter* filter) const override;
  std::size_t memory_bytes() const override;

 private:
  std::uint32_t light_of(const Ray& ray) const;

  SceneAccel accel_;
  float light_scale_;  // two lights closer than its inverse count as one
  RecordedRays* rays_;
  mutable std::uint32_t depth_ = 0;
};

}  // namespace tessera::render
