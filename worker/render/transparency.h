#pragma once

#include <array>
#include <cstdint>

#include "worker/geometry/ray.h"
#include "worker/math/vector.h"
#include "worker/sampling/sampler.h"
#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Transparent surfaces a path may pass before it is given up and counted.
inline constexpr int kTransparencyLimit = 1024;

/// Names the decisions of one ray: chance is tied to sample, bounce, kind of ray and triangle, not
/// to the order surfaces are met in ("The bits", rule 5).
struct RayChance {
  const Sampler& sampler;
  std::uint32_t bounce = 0;
  RayKind kind = RayKind::path;

  /// In [0, 1).
  float at(const TriangleId& id) const {
    return sampler.chance(bounce, kind, id.instance, id.primitive, id.triangle);
  }
};

/// The same for whether light goes straight through a thin sheet or is scattered by it.
inline float straight_chance(const Sampler& sampler, std::uint32_t bounce, const TriangleId& id) {
  const std::uint64_t what = combine(pack(bounce, id.instance), pack(id.primitive, id.triangle));
  return unit_float(sampler.hash(what));
}

/// Decides hit by hit what a ray from the camera or a bounce sees: false for alpha holes, unlit
/// surfaces after the camera, and hidden back faces.
struct ClosestFilter {
  const ShadingScene& scene;
  RayChance chance;
  Vec3f direction;
  std::uint8_t traits = 0;  // kTrait bits that matter to this ray
  int* passed = nullptr;    // counts the holes
  float time = 0;           // of the ray
  MovedSurface* moved = nullptr;

  bool operator()(const Hit& hit) const;
};

/// Lets everything pass and counts the holes among it, in a second look at a ray that seems to have
/// met too many: closest_hit() may show a filter hits beyond the closest.
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

/// Light through one thin sheet, kept until all sheets of the ray are known.
struct ThinSurface {
  float t;
  TriangleId id;
  Vec3f transmittance;
};

/// The sheets a shadow ray met so far; scratch memory of a thread.
struct ThinSurfaceStack {
  int passed = 0;  // holes and sheets
  int count = 0;   // of `sheets` in use
  std::array<ThinSurface, kTransparencyLimit> sheets;

  /// Product of all transmittances, multiplied in (t, id) order so that rounding does not depend
  /// on the traversal. Requires passed <= kTransparencyLimit.
  Vec3f transmittance();
};

/// Decides hit by hit what stops a shadow ray; coloured sheets are gathered in `stack`.
struct ShadowFilter {
  const ShadingScene& scene;
  RayChance chance;
  Vec3f direction;    // unit, towards the light
  TriangleId target;  // the emitter the ray goes to, which does not shadow itself
  std::uint8_t traits = 0;
  ThinSurfaceStack* stack = nullptr;
  float time = 0;  // of the ray
  MovedSurface* moved = nullptr;

  bool operator()(const Hit& hit) const;
};

}  // namespace tessera::render
