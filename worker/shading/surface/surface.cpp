#include "worker/shading/surface/surface.h"

#include <cmath>

#include "worker/geometry/motion.h"
#include "worker/geometry/shapes/shape_surface.h"
#include "worker/math/elementary.h"
#include "worker/shading/surface/surface_extensions.h"
#include "worker/shading/surface/surface_lookup.h"

namespace tessera::render {

using surface_lookup::interpolated;
using surface_lookup::normal_mapped;
using surface_lookup::read;
using surface_lookup::vertex_normal;
using surface_lookup::viewing_frame;

namespace {

PlacedTriangle placed_triangle(const ShadingPoint& p) {
  const Vec3f* x = p.primitive->positions;
  const Instance& instance = *p.instance->source;
  return {instance.object_to_world, instance.world_to_object, x[p.vertices[0]], x[p.vertices[1]],
          x[p.vertices[2]]};
}

inline __attribute__((always_inline)) ShadingPoint triangle_at(const ShadingScene& scene,
                                                               const InstanceView& instance,
                                                               const PrimitiveView& primitive,
                                                               const Hit& hit,
                                                               const Vec3f& direction) {
  ShadingPoint p;
  p.instance = &instance;
  p.primitive = &primitive;
  p.material = &scene.materials[static_cast<std::size_t>(p.primitive->material)];
  p.vertices = p.primitive->triangles[hit.id.triangle];
  p.b1 = hit.b1;
  p.b2 = hit.b2;
  p.geometric_normal = world_normal(placed_triangle(p));
  p.front = dot(p.geometric_normal, direction) < 0;
  return p;
}

/// Values of the three vertices between two keys, or constant ones; null if absent.
template <typename T>
const T* corners_between(const T* still, const std::vector<T>* from, const std::vector<T>* to,
                         const std::array<std::uint32_t, 3>& vertices, float f,
                         std::array<T, 3>& out) {
  if (still == nullptr) return nullptr;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::uint32_t v = vertices[i];
    out[i] = from == nullptr ? still[v] : lerp_bounded((*from)[v], (*to)[v], f);
  }
  return out.data();
}

/// The triangle that was hit of a deforming mesh, interpolated between two keys.
void move_triangle(const Mesh& mesh, const TriangleId& id, const KeyframePosition& at,
                   const PrimitiveView& still, MovedSurface& memory) {
  static constexpr std::array<std::uint32_t, 3> kCorners = {0, 1, 2};
  const Primitive& from = mesh.keys[at.segment][id.primitive];
  const Primitive& to = mesh.keys[at.segment + 1][id.primitive];
  const std::array<std::uint32_t, 3>& v = still.triangles[id.triangle];
  PrimitiveView& p = memory.primitive;
  p = still;
  p.positions =
      corners_between(still.positions, &from.positions, &to.positions, v, at.f, memory.positions);
  p.normals = corners_between(still.normals, &from.normals, &to.normals, v, at.f, memory.normals);
  p.tangents =
      corners_between(still.tangents, &from.tangents, &to.tangents, v, at.f, memory.tangents);
  for (std::size_t k = 0; k < 2; ++k) {
    p.uv[k] = corners_between<Vec2f>(still.uv[k], nullptr, nullptr, v, 0, memory.uv[k]);
  }
  p.colors = corners_between<Vec4f>(still.colors, nullptr, nullptr, v, 0, memory.colors);
  p.triangles = &kCorners;
}

ShadingPoint shape_at(const ShadingScene& scene, const InstanceView& instance, const Hit& hit) {
  ShadingPoint p;
  p.instance = &instance;
  p.primitive = &scene.primitives[p.instance->first_primitive];
  p.material = &scene.materials[static_cast<std::size_t>(p.primitive->material)];
  p.shape = p.instance->shape;
  p.face = hit.id.triangle;
  p.local = {hit.b0, hit.b1, hit.b2};
  const Vec3d outwards = shape_normal(*p.shape, p.face, Vec3d(p.local));
  p.geometric_normal =
      Vec3f(normalize(transform_normal(p.instance->source->world_to_object, outwards)));
  return p;
}

BsdfParameters parameters_at(const ShadingScene& scene, const ShadingPoint& p, const Vec4f& base) {
  const Material& m = *p.material->source;
  BsdfParameters b;
  b.base = base.xyz();
  b.ior = m.ior;
  b.f0 = p.material->f0;
  b.front = p.front;
  b.interface = p.material->interface;
  if (m.specular_glossiness) {
    const Vec4f texel = read(scene, p, m.specular_glossiness_texture);
    b.f0 *= texel.xyz();
    b.base *= 1 - max_component(b.f0);
    b.roughness = 1 - m.glossiness * texel.w;
    b.specular_glossiness = true;
  } else {
    const Vec4f texel = read(scene, p, m.metallic_roughness_texture);
    b.metallic = m.metallic * texel.z;
    b.roughness = m.roughness * texel.y;
    if (m.specular_texture) b.specular_weight = read(scene, p, m.specular_texture).w;
    b.specular_weight *= m.specular;
    if (m.specular_color_texture) b.f0 *= read(scene, p, m.specular_color_texture).xyz();
    b.f0 = min(b.f0, Vec3f{1, 1, 1});
  }
  b.metallic = clamp(b.metallic, 0.0f, 1.0f);
  b.roughness = clamp(b.roughness, 0.0f, 1.0f);
  b.transmission = m.transmission;
  if (m.transmission_texture) b.transmission *= read(scene, p, m.transmission_texture).x;
  return b;
}

}  // namespace

ShadingPoint solid_at(const ShadingScene& scene, const InstanceView& instance, const Hit& hit,
                      const Vec3f& direction) {
  Hit plain = hit;
  plain.id.triangle &= ~kFlippedSide;
  ShadingPoint p = instance.shape != nullptr
                       ? shape_at(scene, instance, plain)
                       : triangle_at(scene, instance, scene.primitive(plain.id), plain, direction);
  p.flipped = plain.id != hit.id;
  if (p.flipped) p.geometric_normal = -p.geometric_normal;
  p.front = dot(p.geometric_normal, direction) < 0;
  return p;
}

ShadingPoint surface_at(const ShadingScene& scene, const TriangleId& id, float b1, float b2,
                        const Vec3f& direction) {
  const InstanceView& instance = scene.instances[id.instance];
  return triangle_at(scene, instance, scene.primitives[instance.first_primitive + id.primitive],
                     {0, id, 0, b1, b2}, direction);
}

ShadingPoint moved_at(const ShadingScene& scene, const Hit& hit, const Vec3f& direction, float time,
                      MovedSurface& memory) {
  const InstanceView& still = scene.instances[hit.id.instance];
  const std::vector<float>& times = scene.source.key_times;  // empty if motion is only assumed
  const KeyframePosition at = times.empty() ? KeyframePosition{} : find_key(times, time);
  memory.posed_instance = *still.source;
  memory.instance = still;
  memory.instance.source = &memory.posed_instance;
  if (still.source->motion != kNone) {
    const auto& motion = scene.source.motions[static_cast<std::size_t>(still.source->motion)];
    const auto pose = pose_at(motion, at);
    if (pose) {  // always, because the ray hit it
      memory.posed_instance.object_to_world = pose->object_to_world;
      memory.posed_instance.world_to_object = pose->world_to_object;
    }
    memory.posed_instance.flips_winding = determinant(memory.posed_instance.object_to_world) < 0;
    memory.instance.object_to_world = Affine3f(memory.posed_instance.object_to_world);
    memory.instance.world_to_object = Affine3f(memory.posed_instance.world_to_object);
    memory.instance.handedness = memory.posed_instance.flips_winding ? -1.0f : 1.0f;
  }
  if (still.solid) return solid_at(scene, memory.instance, hit, direction);
  const PrimitiveView& primitive = scene.primitive(hit.id);
  const Mesh& mesh = scene.source.meshes[static_cast<std::size_t>(still.source->mesh)];
  if (mesh.keys.empty()) {
    return triangle_at(scene, memory.instance, primitive, hit, direction);
  }
  move_triangle(mesh, hit.id, at, primitive, memory);
  Hit alone = hit;
  alone.id.triangle = 0;  // the only triangle
  return triangle_at(scene, memory.instance, memory.primitive, alone, direction);
}

SurfacePoint position_of(const ShadingPoint& p) {
  if (p.shape != nullptr) [[unlikely]]
    return placed_shape_point(p.instance->source->object_to_world, p.local, p.geometric_normal);
  return surface_point(placed_triangle(p), p.b1, p.b2, p.geometric_normal);
}

void offset_shadow_terminator(const Vec3f& wo, ShadingPoint* p, SurfacePoint* position) {
  if (!p->primitive->curved) return;
  const float outwards = p->front == p->flipped ? -1.0f : 1.0f;  // on the viewer's side
  const Vec3f *x = p->primitive->positions, *n = p->primitive->normals;
  const Vec3f e1 = x[p->vertices[1]] - x[p->vertices[0]],
              e2 = x[p->vertices[2]] - x[p->vertices[0]];
  const Vec3f from_first = e1 * p->b1 + e2 * p->b2;
  const std::array<Vec3f, 3> from = {from_first, from_first - e1, from_first - e2};
  const std::array<float, 3> share = {1 - p->b1 - p->b2, p->b1, p->b2};
  Vec3f lift;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3f& normal = n[p->vertices[k]];
    const float below = -outwards * dot(from[k], normal);  // the same in object and world space
    if (!(below > 0)) continue;
    const Vec3f world = transform_normal(p->instance->world_to_object, normal);
    const float squared = dot(world, world);
    if (squared > 0) lift += world * (outwards * share[k] * below / squared);
  }
  // Offsets below the error bounds gain nothing, and rays could start inside.
  const Vec3f geometric = p->front ? p->geometric_normal : -p->geometric_normal;
  float min_lift = 0;
  for (int k = 0; k < 3; ++k) min_lift += 4 * std::fabs(geometric[k]) * position->tolerance[k];
  if (!(dot(lift, geometric) > min_lift)) return;
  const Vec3f curved = vertex_normal(*p);
  if (!(dot(p->front ? curved : -curved, wo) > 0)) return;
  p->raised = true;
  p->horizon = curved;
  position->position += lift;
  position->tolerance = {};  // the triangle lies below
  position->depth_tolerance = 0;
}

Vec4f base_color_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Material& m = *p.material->source;
  Vec4f c = m.base_color;
  if (m.base_color_texture) {
    const Vec4f t = read(scene, p, m.base_color_texture);
    c = {c.x * t.x, c.y * t.y, c.z * t.z, c.w * t.w};
  }
  if (p.primitive->colors != nullptr) {
    const Vec4f v = interpolated(p.primitive->colors, p);
    c = {c.x * v.x, c.y * v.y, c.z * v.z, c.w * v.w};
  }
  return c;
}

float coverage_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Material& m = *p.material->source;
  if (m.alpha_mode == AlphaMode::opaque) return 1;
  const float alpha = base_color_at(scene, p).w;
  if (m.alpha_mode == AlphaMode::mask) return alpha >= m.alpha_cutoff ? 1.0f : 0.0f;
  return clamp(alpha, 0.0f, 1.0f);
}

Vec3f emission_at(const ShadingScene& scene, const ShadingPoint& p, const Vec3f& wo) {
  const Material& m = *p.material->source;
  if (!p.material->emissive || (!p.front && !m.double_sided)) return {};
  const Vec3f emission =
      m.emissive_texture ? m.emission * read(scene, p, m.emissive_texture).xyz() : m.emission;
  if (p.material->extended) [[unlikely]]
    return emission * emission_passed_at(scene, p, wo);
  return emission;
}

Vec3f shading_normal_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Vec3f n = vertex_normal(p);
  const Material& m = *p.material->source;
  return m.normal_texture ? normal_mapped(scene, p, m.normal_texture, m.normal_scale, n) : n;
}

Bsdf bsdf_at(const ShadingScene& scene, const ShadingPoint& p, const Vec4f& base, const Vec3f& wo,
             float wavelength) {
  const BsdfFrame frame = viewing_frame(p, shading_normal_at(scene, p), wo);
  if (p.material->lambert) return make_lambert(base.xyz(), frame, wo);
  const BsdfParameters parameters = parameters_at(scene, p, base);
  if (p.material->extended) [[unlikely]]
    return extended_bsdf_at(scene, p, parameters, frame, wo, wavelength);
  return make_bsdf(parameters, p.material->tables, frame, wo);
}

Vec3f beer_transmittance(const Vec3f& extinction, float distance) {
  Vec3f t{1, 1, 1};
  for (int k = 0; k < 3; ++k) {
    if (extinction[k] > 0 && distance > 0) t[k] = elementary::exp(-extinction[k] * distance);
  }
  return t;
}

}  // namespace tessera::render
