#pragma once

#include <array>
#include <cstdint>

#include "worker/geometry/ray.h"
#include "worker/math/vector.h"
#include "worker/sampling/sampler.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Maximum number of transparent surfaces per path or ray; paths beyond it end and are counted.
inline constexpr int kTransparencyLimit = 1024;

/// Random decisions of one ray. They depend on sample, bounce, kind of ray and triangle, not on the
/// order in which surfaces are met (docs/explanation/determinism.md#order-independent-decisions).
struct RayDecisions {
  const Sampler& sampler;
  std::uint32_t bounce = 0;
  RayKind kind = RayKind::path;

  /// Random number in [0, 1) for a triangle.
  float random(const TriangleId& id) const {
    return sampler.chance(bounce, kind, id.instance, id.primitive, id.triangle);
  }
};

/// Random number for whether light passes straight through a thin surface or is scattered.
inline float straight_random(const Sampler& sampler, std::uint32_t bounce, const TriangleId& id) {
  const std::uint64_t key = combine(pack(bounce, id.instance), pack(id.primitive, id.triangle));
  return unit_float(sampler.hash(key));
}

/// Filter of camera and bounce rays: rejects hits on alpha holes, on unlit surfaces (except for
/// camera rays) and on hidden back faces.
struct ClosestFilter {
  const ShadingScene& scene;
  RayDecisions decisions;
  Vec3f direction;
  std::uint8_t traits = 0;  // kTrait bits that matter for this ray
  int* passed = nullptr;    // counts the holes
  float time = 0;           // of the ray
  MovedSurface* moved = nullptr;

  bool operator()(const Hit& hit) const;
};

/// Rejects every hit and counts alpha holes, to re-trace a ray that seems to exceed the limit,
/// because closest_hit() may show a filter hits beyond the closest.
struct HoleCounter {
  const ClosestFilter& holes;
  int* count;

  bool operator()(const Hit& hit) const {
    const int before = *holes.passed;
    holes(hit);
    *count += *holes.passed - before;
    return false;
  }
};

/// Light through one thin surface, kept until all surfaces of the ray are known.
struct ThinSurface {
  float t;
  TriangleId id;
  Vec3f transmittance;
};

/// Thin surfaces along a shadow ray; scratch memory of a thread.
struct ThinSurfaceStack {
  int passed = 0;  // alpha holes and thin surfaces
  int count = 0;   // used elements of `surfaces`
  std::array<ThinSurface, kTransparencyLimit> surfaces;

  /// Product of all transmittances, multiplied in (t, id) order so that rounding does not depend on
  /// the traversal. Requires passed <= kTransparencyLimit.
  Vec3f transmittance();
};

/// Filter of shadow rays: accepts hits that block light and collects coloured thin surfaces in
/// `stack`.
struct ShadowFilter {
  const ShadingScene& scene;
  RayDecisions decisions;
  Vec3f direction;    // unit, towards the light
  TriangleId target;  // the emitter at the ray's end, which does not shadow itself
  std::uint8_t traits = 0;
  ThinSurfaceStack* stack = nullptr;
  float time = 0;  // of the ray
  MovedSurface* moved = nullptr;

  bool operator()(const Hit& hit) const;
};

}  // namespace tessera::render
