#pragma once

#include <array>

#include "worker/geometry/ray.h"
#include "worker/geometry/surface_point.h"
#include "worker/math/vector.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// A hit as geometry: where it is and which way it faces. Made for every hit; materials are only
/// looked at by the functions below, when they are wanted.
struct ShadingPoint {
  const PrimitiveView* primitive = nullptr;
  const InstanceView* instance = nullptr;
  const MaterialView* material = nullptr;
  std::array<std::uint32_t, 3> vertices{};
  float b1 = 0, b2 = 0;          // barycentrics of the second and third vertex
  const Shape* shape = nullptr;  // in the place of the triangle, or null
  std::uint32_t face = 0;        // of it
  Vec3f local;                   // the point on it, object space
  Vec3f geometric_normal;        // world, unit, out of the front face (also of mirrored instances)
  bool front = true;             // the ray met the front face
  bool flipped = false;          // the front is what the mesh has as its back (kFlippedSide)
  bool raised = false;           // light comes and goes by another horizon, on the front side:
  Vec3f horizon;
  float footprint = 0;  // width of what is seen here, metres; 0: a point. For procedures
};

/// The point of a triangle that was met along `direction`.
ShadingPoint surface_at(const ShadingScene& scene, const TriangleId& id, float b1, float b2,
                        const Vec3f& direction);
/// That of a shape, or of an operand of a CSG solid, placed as `instance` says.
ShadingPoint solid_at(const ShadingScene& scene, const InstanceView& instance, const Hit& hit,
                      const Vec3f& direction);

/// Memory for a surface as it is at one time, which its ShadingPoint looks into.
struct MovedSurface {
  Instance place;
  InstanceView instance;
  PrimitiveView primitive;
  std::array<Vec3f, 3> positions, normals;  // of the triangle met
  std::array<Vec4f, 3> tangents, colors;
  std::array<std::array<Vec2f, 3>, 2> uv;
};
/// The point of what moves while the shutter is open, as it is at the ray's time.
ShadingPoint moved_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction, float time,
                      MovedSurface& memory);

/// The point `hit` found along `direction`.
inline ShadingPoint surface_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction) {
  const InstanceView& instance = scene.instances[hit.id.instance];
  if (instance.solid) [[unlikely]]
    return solid_at(scene, instance, hit, direction);
  return surface_at(scene, hit.id, hit.b1, hit.b2, direction);
}
/// The same at a time; of what moves it looks into `memory`.
inline ShadingPoint surface_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction,
                               float time, MovedSurface& memory) {
  const InstanceView& instance = scene.instances[hit.id.instance];
  if (instance.special) [[unlikely]] {
    return instance.moves ? moved_at(scene, hit, direction, time, memory)
                          : solid_at(scene, instance, hit, direction);
  }
  return surface_at(scene, hit.id, hit.b1, hit.b2, direction);
}

/// Where that is, with what rays that start there need.
SurfacePoint position_of(const ShadingPoint& point);

/// Where vertex normals bulge over a flat triangle, light leaves from the curve that they describe:
/// its horizon is the vertex normal's, and `position` moves up there, so that neighbouring
/// triangles throw no shadow where a curved surface would have none. Each vertex's tangent plane
/// that lies above the point pulls it up by its barycentric share. Nothing happens in hollows, and
/// where the viewer is below the curve's horizon. Source: Hanika, "Hacking the Shadow Terminator",
/// Ray Tracing Gems II, chapter 4. `wo`: unit, world, towards the viewer.
void offset_shadow_terminator(const Vec3f& wo, ShadingPoint* point, SurfacePoint* position);

/// Base colour and alpha: factor times texture times vertex colour.
Vec4f base_color_at(const ShadingScene& scene, const ShadingPoint& point);

/// Coverage by alphaMode: 1 for OPAQUE, 0 or 1 for MASK (opaque at the cutoff), alpha for BLEND.
float coverage_at(const ShadingScene& scene, const ShadingPoint& point);

/// Radiance in nits towards `wo` (unit, world); zero on the dark side.
Vec3f emission_at(const ShadingScene& scene, const ShadingPoint& point, const Vec3f& wo);

/// Shading normal in world space on the front side, unit: interpolated, then normal-mapped.
Vec3f shading_normal_at(const ShadingScene& scene, const ShadingPoint& point);

/// What the surface does to light arriving from or leaving to `wo` (unit, world, towards the
/// viewer). `base` is base_color_at(). The shading normal is bent where it faces away from the
/// viewer or where its mirror direction would lie below the surface.
/// `wavelength` (nanometres) matters to dispersive materials only; 0: they refract as at 587.6 nm.
Bsdf bsdf_at(const ShadingScene& scene, const ShadingPoint& point, const Vec4f& base,
             const Vec3f& wo, float wavelength = 0);

/// Beer's law over `distance` metres: exp(-extinction distance). 0 for infinite extinction and
/// any distance above 0; never NaN.
Vec3f beer_transmittance(const Vec3f& extinction, float distance);

}  // namespace tessera::render
