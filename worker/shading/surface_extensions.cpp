#include "worker/shading/surface_extensions.h"

#include "worker/shading/fresnel.h"
#include "worker/shading/surface_lookup.h"

namespace tessera::render {

using surface_lookup::normal_mapped;
using surface_lookup::read;
using surface_lookup::vertex_normal;
using surface_lookup::viewing_frame;

namespace {

float coat_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Clearcoat& c = p.material->source->clearcoat;
  return c.factor * read(scene, p, c.texture).x;
}

/// Of the coat, which does not follow the normal map of what lies below.
BsdfFrame coat_frame_at(const ShadingScene& scene, const ShadingPoint& p, const Vec3f& wo) {
  const Clearcoat& c = p.material->source->clearcoat;
  Vec3f n = vertex_normal(p);
  if (c.normal_texture) n = normal_mapped(scene, p, c.normal_texture, c.normal_scale, n);
  return viewing_frame(p, n, wo);
}

}  // namespace

Bsdf extended_bsdf_at(const ShadingScene& scene, const ShadingPoint& p,
                      const BsdfParameters& parameters, const BsdfFrame& frame, const Vec3f& wo) {
  const Material& m = *p.material->source;
  BsdfExtensions e;
  BsdfFrame coat_frame;
  e.coat = coat_at(scene, p);
  if (e.coat > 0) {
    e.coat_roughness =
        clamp(m.clearcoat.roughness * read(scene, p, m.clearcoat.roughness_texture).y, 0.0f, 1.0f);
    coat_frame = coat_frame_at(scene, p, wo);
  }
  return make_extended_bsdf(parameters, e, p.material->tables, frame, coat_frame, wo);
}

float emission_passed_at(const ShadingScene& scene, const ShadingPoint& p, const Vec3f& wo) {
  const float coat = coat_at(scene, p);
  if (!(coat > 0)) return 1;
  return 1 - coat_reflectance(coat, clamp(dot(coat_frame_at(scene, p, wo).normal, wo), 0.0f, 1.0f));
}

}  // namespace tessera::render
