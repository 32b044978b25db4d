#pragma once

#include <bit>
#include <cstdint>
#include <optional>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/ray.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// The delta lobes that a path has followed are a number: in binary a one, then two bits for each.
/// 0 stands for more than 31 lobes.
inline constexpr std::uint64_t kNoLobes = 1;
inline constexpr std::uint64_t with_lobe(std::uint64_t lobes, DeltaLobe lobe) {
  return lobes >> 62 != 0 ? 0 : lobes << 2 | static_cast<std::uint64_t>(lobe);
}

/// The lobe after `followed` of all `lobes`, of which `followed` are the first; nullopt if none is.
inline std::optional<DeltaLobe> next_lobe(std::uint64_t followed, std::uint64_t lobes) {
  const int shift =
      static_cast<int>(std::bit_width(lobes)) - static_cast<int>(std::bit_width(followed)) - 2;
  if (shift < 0) return std::nullopt;
  return static_cast<DeltaLobe>(lobes >> shift & 3);
}

/// A straight part of a path from the camera that has only followed delta lobes.
struct SpecularSegment {
  Ray ray;                  // unit direction; t_max: to the next surface, or infinite
  std::uint64_t way = 0;    // hash of the surfaces and lobes before it
  std::uint64_t turns = 0;  // at each surface, two bits, the first one lowest
  std::int32_t surfaces = 0;
  std::uint64_t lobes = kNoLobes;  // DeltaLobes
  float throughput = 1;            // luminance of the product of the lobes' reflectances
  float probability = 1;           // of a path following these lobes
  float emitted = 0;               // luminance at its end; only follow() sets it
};

/// Follows camera rays along all delta lobes. Media do not affect the rays.
class SpecularTracer {
 public:
  /// Both must outlive the tracer. `max_depth`: scattering events.
  SpecularTracer(const ShadingScene& shading, const SceneAccel& accel, std::int32_t max_depth);

  /// Appends the segments of all ways with a throughput of at least 0.0001.
  void trace(const Ray& camera_ray, std::vector<SpecularSegment>* segments);

  /// The segment that a camera ray reaches by the turns of `like`; nullopt if it meets other
  /// surfaces.
  std::optional<SpecularSegment> follow(const Ray& camera_ray, const SpecularSegment& like);

 private:
  /// The surface at the end of a segment.
  struct End;
  std::optional<End> end_of(SpecularSegment* segment);
  std::optional<SpecularSegment> next(const SpecularSegment& segment, const End& end,
                                      std::uint64_t turn) const;
  void branch(SpecularSegment segment, std::vector<SpecularSegment>* segments);

  const ShadingScene& shading_;
  const SceneAccel& accel_;
  std::int32_t max_surfaces_;
  MovedSurface memory_;
};

}  // namespace tessera::render
