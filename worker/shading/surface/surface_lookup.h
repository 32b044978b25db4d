#pragma once

#include "worker/geometry/frame.h"
#include "worker/geometry/shapes/shape_surface.h"
#include "worker/shading/microfacet/microfacet.h"
#include "worker/shading/surface/surface.h"
#include "worker/shading/surface/surface_procedural.h"

/// Vertex attributes and textures at a point of a surface. Used by surface.cpp and
/// surface_extensions.cpp only.
namespace tessera::render::surface_lookup {

/// a + b1 (b - a) + b2 (c - a): exact if the three values are equal.
template <typename T>
inline T interpolated(const T* values, const ShadingPoint& p) {
  const T a = values[p.vertices[0]], b = values[p.vertices[1]], c = values[p.vertices[2]];
  return a + (b - a) * p.b1 + (c - a) * p.b2;
}

inline Vec2f uv_at(const ShadingPoint& p, const TextureRef& ref) {
  const Vec2f* uv = p.primitive->uv[ref.uv_set == 1 ? 1 : 0];
  if (uv == nullptr) return p.shape == nullptr ? Vec2f{} : shape_uv(*p.shape, p.face, p.local);
  return interpolated(uv, p);
}

inline __attribute__((always_inline)) Vec4f read(const ShadingScene& scene, const ShadingPoint& p,
                                                 const TextureRef& ref) {
  if (!ref) return {1, 1, 1, 1};
  if (const ProceduralTexture* f = scene.textures.procedural(ref)) [[unlikely]]
    return procedural_color_at(scene, p, ref, *f);
  return scene.textures.lookup(ref, uv_at(p, ref));
}

/// Tangent of the triangle's UV parametrisation, object space; zero if there is none.
inline Vec4f tangent_from_uv(const ShadingPoint& p, const TextureRef& ref) {
  const Vec2f* uv = p.primitive->uv[ref.uv_set == 1 ? 1 : 0];
  if (uv == nullptr) return p.shape == nullptr ? Vec4f{} : shape_tangent(*p.shape, p.face, p.local);
  const Vec3f* x = p.primitive->positions;
  const Vec3f e1 = x[p.vertices[1]] - x[p.vertices[0]], e2 = x[p.vertices[2]] - x[p.vertices[0]];
  const Vec2f d1 = uv[p.vertices[1]] - uv[p.vertices[0]],
              d2 = uv[p.vertices[2]] - uv[p.vertices[0]];
  const float det = difference_of_products(d1.x, d2.y, d1.y, d2.x);
  const float sign = det < 0 ? -1.0f : 1.0f;
  const Vec3f t = normalize((e1 * d2.y - e2 * d1.y) * sign);
  return {t.x, t.y, t.z, sign};
}

/// Directions of increasing u and v on the surface, perpendicular to a normal; zero if unknown.
struct TangentPair {
  Vec3f tangent, bitangent;
};

/// `ref` selects the texture coordinates to use if the mesh has no tangents.
inline TangentPair tangents_at(const ShadingPoint& p, const TextureRef& ref, const Vec3f& normal) {
  const Vec4f object_tangent = p.primitive->tangents != nullptr
                                   ? interpolated(p.primitive->tangents, p)
                                   : tangent_from_uv(p, ref);
  const Vec3f along = transform_vector(p.instance->object_to_world, object_tangent.xyz());
  const Vec3f tangent = normalize(along - normal * dot(normal, along));
  if (tangent == Vec3f{}) return {};
  // The world space of a mirrored instance reverses the cross product.
  const float side = (object_tangent.w < 0 ? -1.0f : 1.0f) * p.instance->handedness;
  return {tangent, cross(normal, tangent) * side};
}

/// `normal` perturbed by a normal texture; unchanged if tangent or texel are degenerate.
inline Vec3f normal_mapped(const ShadingScene& scene, const ShadingPoint& p, const TextureRef& ref,
                           float scale, const Vec3f& normal) {
  if (const ProceduralTexture* f = scene.textures.procedural(ref)) [[unlikely]]
    return procedural_bumped(scene, p, ref, *f, scale, normal);
  const TangentPair axes = tangents_at(p, ref, normal);
  if (axes.tangent == Vec3f{}) return normal;
  const Vec4f texel = read(scene, p, ref);
  const float x = (texel.x * 2 - 1) * scale, y = (texel.y * 2 - 1) * scale;
  const float z = texel.z * 2 - 1;
  const Vec3f tilted = normalize(axes.tangent * x + axes.bitangent * y + normal * z);
  return tilted == Vec3f{} || !is_finite(tilted) ? normal : tilted;
}

/// Interpolated normal on the front side, unit.
inline __attribute__((always_inline)) Vec3f vertex_normal(const ShadingPoint& p) {
  if (p.primitive->normals == nullptr) return p.geometric_normal;
  const Vec3f smooth = normalize(
      transform_normal(p.instance->world_to_object, interpolated(p.primitive->normals, p)));
  return smooth == Vec3f{} ? p.geometric_normal : p.flipped ? -smooth : smooth;
}

/// Frame with both normals on the viewer's side; the shading normal is bent if necessary.
inline BsdfFrame viewing_frame(const ShadingPoint& p, const Vec3f& shading_normal,
                               const Vec3f& wo) {
  BsdfFrame frame;
  const Vec3f& horizon = p.raised ? p.horizon : p.geometric_normal;
  frame.geometric_normal = p.front ? horizon : -horizon;
  Vec3f n = p.front ? shading_normal : -shading_normal;
  if (!(dot(n, frame.geometric_normal) > 0)) n = frame.geometric_normal;
  // The mirror direction must lie above the surface: otherwise the normal is turned until it
  // does, which also puts the viewer on its side.
  const Vec3f reflected = n * (2 * dot(n, wo)) - wo;
  const float facing = dot(frame.geometric_normal, wo);
  const float min_height = facing < 0.02f ? 0.5f * facing : 0.01f;
  const float height = dot(frame.geometric_normal, reflected);
  if (height < min_height) {
    n = direction_of(wo + direction_of(reflected + frame.geometric_normal * (min_height - height)));
  }
  frame.normal = n;
  const Frame axes = Frame::from_normal(n);
  frame.tangent = axes.s;
  frame.bitangent = axes.t;
  return frame;
}

}  // namespace tessera::render::surface_lookup
