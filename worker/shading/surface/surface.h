#pragma once

#include <array>

#include "worker/geometry/ray.h"
#include "worker/geometry/surface_point.h"
#include "worker/math/vector.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// Geometry of a hit: its position and orientation. Made for every hit; the functions below read
/// the material only when it is needed.
struct ShadingPoint {
  const PrimitiveView* primitive = nullptr;
  const InstanceView* instance = nullptr;
  const MaterialView* material = nullptr;
  std::array<std::uint32_t, 3> vertices{};
  float b1 = 0, b2 = 0;          // barycentrics of the second and third vertex
  const Shape* shape = nullptr;  // instead of a triangle, or null
  std::uint32_t face = 0;        // face of the shape
  Vec3f local;                   // point on the shape, object space
  Vec3f geometric_normal;  // world, unit, pointing out of the front (also for mirrored instances)
  bool front = true;       // the ray hit the front
  bool flipped = false;    // the front is what the mesh has as its back (kFlippedSide)
  bool raised = false;     // `horizon` replaces geometric_normal on the front side:
  Vec3f horizon;
  float footprint = 0;  // filter width of procedural textures here, metres; 0: a point
};

/// Hit on a triangle along `direction`.
ShadingPoint surface_at(const ShadingScene& scene, const TriangleId& id, float b1, float b2,
                        const Vec3f& direction);
/// Hit on a shape, or on an operand of a CSG solid, placed by `instance`.
ShadingPoint solid_at(const ShadingScene& scene, const InstanceView& instance, const Hit& hit,
                      const Vec3f& direction);

/// Memory for a surface posed at one time; its ShadingPoint refers to it.
struct MovedSurface {
  Instance posed_instance;
  InstanceView instance;
  PrimitiveView primitive;
  std::array<Vec3f, 3> positions, normals;  // of the triangle hit
  std::array<Vec4f, 3> tangents, colors;
  std::array<std::array<Vec2f, 3>, 2> uv;
};
/// Hit on an object that moves during the exposure, at the ray's time.
ShadingPoint moved_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction, float time,
                      MovedSurface& memory);

/// The shading point of `hit`, found along `direction`.
inline ShadingPoint surface_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction) {
  const InstanceView& instance = scene.instances[hit.id.instance];
  if (instance.solid) [[unlikely]]
    return solid_at(scene, instance, hit, direction);
  return surface_at(scene, hit.id, hit.b1, hit.b2, direction);
}
/// The shading point of `hit` at a time; for moving objects it refers to `memory`.
inline ShadingPoint surface_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction,
                               float time, MovedSurface& memory) {
  const InstanceView& instance = scene.instances[hit.id.instance];
  if (instance.special) [[unlikely]] {
    return instance.moves ? moved_at(scene, hit, direction, time, memory)
                          : solid_at(scene, instance, hit, direction);
  }
  return surface_at(scene, hit.id, hit.b1, hit.b2, direction);
}

/// Returns the position and error bounds for spawning rays.
SurfacePoint position_of(const ShadingPoint& point);

/// Shadow terminator correction: moves `position` towards the smooth surface that the vertex
/// normals describe, and makes the vertex normal the horizon, so that neighbouring triangles cast
/// no false shadows. Each vertex's tangent plane that lies above the point pulls it up by its
/// barycentric weight. Does nothing on concave surfaces and where the viewer is below the smooth
/// horizon. `wo`: unit, world, towards the viewer. Source: Hanika, "Hacking the Shadow Terminator",
/// Ray Tracing Gems II, chapter 4.
void offset_shadow_terminator(const Vec3f& wo, ShadingPoint* point, SurfacePoint* position);

/// Base colour and alpha: factor * texture * vertex colour.
Vec4f base_color_at(const ShadingScene& scene, const ShadingPoint& point);

/// Coverage by alphaMode: 1 for OPAQUE, 0 or 1 for MASK (opaque at the cutoff), alpha for BLEND.
float coverage_at(const ShadingScene& scene, const ShadingPoint& point);

/// Emitted radiance in nits towards `wo` (unit, world); zero on the non-emitting side.
Vec3f emission_at(const ShadingScene& scene, const ShadingPoint& point, const Vec3f& wo);

/// Shading normal on the front side, world space, unit: interpolated, then normal-mapped.
Vec3f shading_normal_at(const ShadingScene& scene, const ShadingPoint& point);

/// BSDF at the hit for a viewer in direction `wo` (unit, world). For nested solids the index of
/// refraction is relative to the outer one. `base` is base_color_at(). The shading normal is bent
/// if it faces away from the viewer or its mirror direction lies below the surface. `wavelength`
/// (nanometres) affects dispersive materials only; 0: refraction as at 587.6 nm.
Bsdf bsdf_at(const ShadingScene& scene, const ShadingPoint& point, const Vec4f& base,
             const Vec3f& wo, float wavelength = 0);

/// Beer's law over `distance` metres: exp(-extinction distance). 0 for infinite extinction and
/// any distance above 0; never NaN.
Vec3f beer_transmittance(const Vec3f& extinction, float distance);

}  // namespace tessera::render
