#include "worker/shading/surface.h"

#include "worker/geometry/frame.h"
#include "worker/math/elementary.h"
#include "worker/shading/microfacet.h"

namespace tessera::render {
namespace {

/// a + b1 (b - a) + b2 (c - a): exact where the three corners agree.
template <typename T>
T interpolated(const T* values, const ShadingPoint& p) {
  const T a = values[p.vertices[0]], b = values[p.vertices[1]], c = values[p.vertices[2]];
  return a + (b - a) * p.b1 + (c - a) * p.b2;
}

PlacedTriangle placed_triangle(const ShadingPoint& p) {
  const Vec3f* x = p.primitive->positions;
  const Instance& instance = *p.instance->source;
  return {instance.object_to_world, instance.world_to_object, x[p.vertices[0]], x[p.vertices[1]],
          x[p.vertices[2]]};
}

Vec2f uv_at(const ShadingPoint& p, const TextureRef& ref) {
  const Vec2f* uv = p.primitive->uv[ref.uv_set == 1 ? 1 : 0];
  return uv == nullptr ? Vec2f{} : interpolated(uv, p);
}

Vec4f read(const ShadingScene& scene, const ShadingPoint& p, const TextureRef& ref) {
  if (!ref) return {1, 1, 1, 1};
  return scene.textures.lookup(ref, uv_at(p, ref));
}

/// Tangent of the UV parametrisation of the triangle, object space; zero if there is none.
Vec4f tangent_from_uv(const ShadingPoint& p, const TextureRef& ref) {
  const Vec2f* uv = p.primitive->uv[ref.uv_set == 1 ? 1 : 0];
  if (uv == nullptr) return {};
  const Vec3f* x = p.primitive->positions;
  const Vec3f e1 = x[p.vertices[1]] - x[p.vertices[0]], e2 = x[p.vertices[2]] - x[p.vertices[0]];
  const Vec2f d1 = uv[p.vertices[1]] - uv[p.vertices[0]],
              d2 = uv[p.vertices[2]] - uv[p.vertices[0]];
  const float det = difference_of_products(d1.x, d2.y, d1.y, d2.x);
  const float sign = det < 0 ? -1.0f : 1.0f;
  const Vec3f t = normalize((e1 * d2.y - e2 * d1.y) * sign);
  return {t.x, t.y, t.z, sign};
}

/// `normal` tilted by the normal texture; itself where tangent or texel are degenerate.
Vec3f normal_mapped(const ShadingScene& scene, const ShadingPoint& p, const Vec3f& normal) {
  const Material& m = *p.material->source;
  const Vec4f object_tangent = p.primitive->tangents != nullptr
                                   ? interpolated(p.primitive->tangents, p)
                                   : tangent_from_uv(p, m.normal_texture);
  const Vec3f along = transform_vector(p.instance->object_to_world, object_tangent.xyz());
  const Vec3f tangent = normalize(along - normal * dot(normal, along));
  if (tangent == Vec3f{}) return normal;
  // World space of a mirrored instance turns the cross product round.
  const float side = (object_tangent.w < 0 ? -1.0f : 1.0f) * p.instance->handedness;
  const Vec3f bitangent = cross(normal, tangent) * side;
  const Vec4f texel = read(scene, p, m.normal_texture);
  const float x = (texel.x * 2 - 1) * m.normal_scale, y = (texel.y * 2 - 1) * m.normal_scale;
  const float z = texel.z * 2 - 1;
  const Vec3f tilted = normalize(tangent * x + bitangent * y + normal * z);
  return tilted == Vec3f{} || !is_finite(tilted) ? normal : tilted;
}

/// Both normals on the viewer's side, the shading one bent so that it really is.
BsdfFrame viewing_frame(const ShadingPoint& p, const Vec3f& shading_normal, const Vec3f& wo) {
  BsdfFrame frame;
  frame.geometric_normal = p.front ? p.geometric_normal : -p.geometric_normal;
  Vec3f n = p.front ? shading_normal : -shading_normal;
  if (!(dot(n, frame.geometric_normal) > 0)) n = frame.geometric_normal;
  // What a mirror shows must lie above the surface: else the normal is turned until it does, which
  // also puts the viewer on its side.
  const Vec3f reflected = n * (2 * dot(n, wo)) - wo;
  const float facing = dot(frame.geometric_normal, wo);
  const float least = facing < 0.02f ? 0.5f * facing : 0.01f;
  const float height = dot(frame.geometric_normal, reflected);
  if (height < least) {
    n = direction_of(wo + direction_of(reflected + frame.geometric_normal * (least - height)));
  }
  frame.normal = n;
  const Frame axes = Frame::from_normal(n);
  frame.tangent = axes.s;
  frame.bitangent = axes.t;
  return frame;
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

ShadingPoint surface_at(const ShadingScene& scene, const TriangleId& id, float b1, float b2,
                        const Vec3f& direction) {
  ShadingPoint p;
  p.instance = &scene.instances[id.instance];
  p.primitive = &scene.primitives[p.instance->first_primitive + id.primitive];
  p.material = &scene.materials[static_cast<std::size_t>(p.primitive->material)];
  p.vertices = p.primitive->triangles[id.triangle];
  p.b1 = b1;
  p.b2 = b2;
  p.geometric_normal = world_normal(placed_triangle(p));
  p.front = dot(p.geometric_normal, direction) < 0;
  return p;
}

SurfacePoint position_of(const ShadingPoint& p) {
  return surface_point(placed_triangle(p), p.b1, p.b2, p.geometric_normal);
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

Vec3f emission_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Material& m = *p.material->source;
  if (!p.material->emissive || (!p.front && !m.double_sided)) return {};
  if (!m.emissive_texture) return m.emission;
  return m.emission * read(scene, p, m.emissive_texture).xyz();
}

Vec3f shading_normal_at(const ShadingScene& scene, const ShadingPoint& p) {
  Vec3f n = p.geometric_normal;
  if (p.primitive->normals != nullptr) {
    const Vec3f smooth = normalize(
        transform_normal(p.instance->world_to_object, interpolated(p.primitive->normals, p)));
    if (!(smooth == Vec3f{})) n = smooth;
  }
  return p.material->source->normal_texture ? normal_mapped(scene, p, n) : n;
}

Bsdf bsdf_at(const ShadingScene& scene, const ShadingPoint& p, const Vec4f& base, const Vec3f& wo) {
  const BsdfFrame frame = viewing_frame(p, shading_normal_at(scene, p), wo);
  return make_bsdf(parameters_at(scene, p, base), p.material->tables, frame, wo);
}

Vec3f beer_transmittance(const Vec3f& extinction, float distance) {
  Vec3f t{1, 1, 1};
  for (int k = 0; k < 3; ++k) {
    if (extinction[k] > 0 && distance > 0) t[k] = elementary::exp(-extinction[k] * distance);
  }
  return t;
}

}  // namespace tessera::render
