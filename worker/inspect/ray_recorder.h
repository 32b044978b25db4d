#pragma once

#include <cstdint>
#include <vector>

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// A shadow ray with what a shadow cache tells apart.
struct ShadowRay {
  Ray ray;
  std::uint32_t depth = 0;  // scattering events before it
  std::uint32_t light = 0;  // a number for where it ends, or where it goes if that is nowhere
};

/// The rays of an image, in the order they were traced.
struct RecordedRays {
  std::vector<Ray> camera, bounces;
  std::vector<ShadowRay> shadows;
};

/// Answers as SceneAccel does and writes down what it is asked. One thread only.
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
  float light_scale_;  // lights nearer to each other than its inverse are one
  RecordedRays* rays_;
  mutable std::uint32_t depth_ = 0;
};

}  // namespace tessera::render
