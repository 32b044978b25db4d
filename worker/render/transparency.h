#pragma once

#include <array>
#include <cstdint>

#include "worker/accel/scene_accel.h"
#include "worker/math/vector.h"
#include "worker/sampling/sampler.h"
#include "worker/shading/shading_scene.h"

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
  std::uint8_t traits = 0;  // SurfaceTrait bits that matter to this ray
  int passed = 0;

  bool operator()(const TriangleId& id, float t, float b1, float b2);
};

/// Light through one thin sheet, kept until all sheets of the ray are known.
struct Sheet {
  float t;
  TriangleId id;
  Vec3f transmittance;
};

/// Decides hit by hit what stops a shadow ray. Coloured sheets are gathered; transmittance()
/// multiplies them in (t, id) order, so that rounding does not depend on the traversal.
struct ShadowFilter {
  const ShadingScene& scene;
  RayChance chance;
  Vec3f direction;    // unit, towards the light
  TriangleId target;  // the emitter the ray goes to, which does not shadow itself
  std::uint8_t traits = 0;
  int passed = 0;
  int sheet_count = 0;
  std::array<Sheet, kTransparencyLimit>* sheets = nullptr;  // scratch of the thread

  bool operator()(const TriangleId& id, float t, float b1, float b2);

  /// Product over the sheets met; requires that nothing stopped the ray and passed is within
  /// kTransparencyLimit.
  Vec3f transmittance();
};

}  // namespace tessera::render
