#include "worker/shading/surface/surface_extensions.h"

#include <algorithm>
#include <vector>

#include "worker/math/elementary.h"
#include "worker/shading/microfacet/dispersion.h"
#include "worker/shading/microfacet/fresnel.h"
#include "worker/shading/surface/surface_lookup.h"

namespace tessera::render {

using surface_lookup::normal_mapped;
using surface_lookup::read;
using surface_lookup::TangentPair;
using surface_lookup::tangents_at;
using surface_lookup::vertex_normal;
using surface_lookup::viewing_frame;

namespace {

float coat_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Clearcoat& c = p.material->source->clearcoat;
  return c.factor * read(scene, p, c.texture).x;
}

/// Frame of the clearcoat, which does not use the normal map of the base.
BsdfFrame coat_frame_at(const ShadingScene& scene, const ShadingPoint& p, const Vec3f& wo) {
  const Clearcoat& c = p.material->source->clearcoat;
  Vec3f n = vertex_normal(p);
  if (c.normal_texture) n = normal_mapped(scene, p, c.normal_texture, c.normal_scale, n);
  return viewing_frame(p, n, wo);
}

/// `frame` rotated so that its tangent is the direction of anisotropy; `strength` is scaled by the
/// texture.
BsdfFrame anisotropic_frame(const ShadingScene& scene, const ShadingPoint& p,
                            const BsdfFrame& frame, float* strength) {
  const Anisotropy& a = p.material->source->anisotropy;
  *strength = a.strength;
  Vec2f direction{1, 0};
  if (a.texture) {
    const Vec4f texel = read(scene, p, a.texture);
    *strength *= texel.z;
    direction = {2 * texel.x - 1, 2 * texel.y - 1};
  }
  const elementary::SinCosf turn = elementary::sincos(a.rotation);
  direction = {turn.cos * direction.x - turn.sin * direction.y,
               turn.sin * direction.x + turn.cos * direction.y};
  // Tangents belong to the normal of the front side.
  const Vec3f front = p.front ? frame.normal : -frame.normal;
  const TextureRef& ref =
      p.material->source->normal_texture ? p.material->source->normal_texture : a.texture;
  const TangentPair axes = tangents_at(p, ref, front);
  const Vec3f along = normalize(axes.tangent * direction.x + axes.bitangent * direction.y);
  BsdfFrame turned = frame;
  if (along == Vec3f{} || !is_finite(along)) return turned;
  turned.tangent = along;
  turned.bitangent = cross(frame.normal, along);
  return turned;
}

ThinFilm film_at(const ShadingScene& scene, const ShadingPoint& p) {
  const Iridescence& i = p.material->source->iridescence;
  ThinFilm film;
  film.weight = i.factor * read(scene, p, i.texture).x;
  film.ior = i.ior;
  film.thickness = i.thickness_maximum;
  const std::vector<float>& caps = p.material->film_caps;
  if (i.thickness_texture) {
    const float share = read(scene, p, i.thickness_texture).y;
    film.thickness = lerp(i.thickness_minimum, i.thickness_maximum, share);
    if (caps.size() > 1) {
      const albedo_grid::Position at = albedo_grid::position(share, caps.size());
      film.cap = std::max(caps[at.index], caps[at.index + 1]);
    }
  } else if (!caps.empty()) {
    film.cap = caps.front();
  }
  if (!(film.thickness > 0)) film.weight = 0;
  return film;
}

/// Replaces the index of refraction at 587.6 nm by that at one wavelength.
void disperse(const Material& m, float wavelength, BsdfParameters* parameters) {
  const float before = f0_from_ior(m.ior);
  parameters->ior = dispersed_ior(m.ior, m.dispersion, wavelength);
  const float after = f0_from_ior(parameters->ior);
  if (parameters->f0 == Vec3f{before, before, before}) {
    parameters->f0 = {after, after, after};
  } else if (before > 0) {
    parameters->f0 = min(parameters->f0 * (after / before), Vec3f{1, 1, 1});
  }
}

}  // namespace

Bsdf extended_bsdf_at(const ShadingScene& scene, const ShadingPoint& p, const BsdfParameters& plain,
                      const BsdfFrame& plain_frame, const Vec3f& wo, float wavelength) {
  const Material& m = *p.material->source;
  BsdfParameters parameters = plain;
  BsdfExtensions e;
  BsdfFrame frame = plain_frame, coat_frame;
  e.coat = coat_at(scene, p);
  if (e.coat > 0) {
    e.coat_roughness =
        clamp(m.clearcoat.roughness * read(scene, p, m.clearcoat.roughness_texture).y, 0.0f, 1.0f);
    coat_frame = coat_frame_at(scene, p, wo);
  }
  if (m.anisotropy.strength > 0) frame = anisotropic_frame(scene, p, frame, &e.anisotropy);
  if (max_component(m.sheen.color) > 0) {
    e.sheen = m.sheen.color * read(scene, p, m.sheen.color_texture).xyz();
    e.sheen_roughness = m.sheen.roughness * read(scene, p, m.sheen.roughness_texture).w;
  }
  if (m.iridescence.factor > 0) e.film = film_at(scene, p);
  if (m.diffuse_transmission.factor > 0) {
    const DiffuseTransmission& d = m.diffuse_transmission;
    e.diffuse_transmission = d.factor * read(scene, p, d.texture).w;
    e.diffuse_transmission_color = d.color * read(scene, p, d.color_texture).xyz();
  }
  e.conductor = p.material->conductor;
  e.exact_fresnel = m.optics.exact_fresnel;
  e.diffuse_roughness = m.optics.diffuse_roughness;
  if (p.material->dispersive && wavelength > 0) disperse(m, wavelength, &parameters);
  return make_extended_bsdf(parameters, e, p.material->tables, frame, coat_frame, wo);
}

float emission_passed_at(const ShadingScene& scene, const ShadingPoint& p, const Vec3f& wo) {
  const float coat = coat_at(scene, p);
  if (!(coat > 0)) return 1;
  return 1 - coat_reflectance(coat, clamp(dot(coat_frame_at(scene, p, wo).normal, wo), 0.0f, 1.0f));
}

}  // namespace tessera::render
