#pragma once

#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/microfacet/fresnel.h"
#include "worker/shading/microfacet/microfacet.h"
#include "worker/shading/tables/anisotropic_albedo.h"

/// Microfacet and Fresnel terms of the base, with and without extensions. Used by base_bsdf.h and
/// base_prepare.h only.
namespace tessera::render::base_bsdf {

using warp::kInvPi;
inline constexpr float kMatchedIndices = 1e-4f;  // |eta - 1| below which facets do not refract

inline Vec2f point_on_circle(float u) {
  const elementary::SinCosf a = elementary::sincos(2 * warp::kPi * u);
  return {a.cos, a.sin};
}

/// Density of facet normals at `h`.
template <bool kExtended>
inline float facet_density(const Bsdf& b, const Vec3f& h) {
  if constexpr (kExtended) {
    if (b.extended->alpha_t > 0) return ggx_d(h, b.extended->alpha_t, b.alpha);
  }
  return ggx_d(h, b.alpha);
}

/// Square root in Smith's term, for `w` on either side.
template <bool kExtended>
inline float facet_root(const Bsdf& b, const Vec3f& w) {
  if constexpr (kExtended) {
    if (b.extended->alpha_t > 0) return smith_root(w, b.extended->alpha_t, b.alpha);
  }
  return smith_root(w.z, b.alpha);
}

/// Single-scattering albedo of perfectly reflecting facets for light leaving along `w`.
template <bool kExtended>
inline float facet_albedo(const Bsdf& b, const Vec3f& w) {
  if constexpr (kExtended) {
    const ExtendedLobes& x = *b.extended;
    if (x.alpha_t > 0) return x.anisotropic->at(w, b.roughness, x.anisotropy);
  }
  return b.reflector->at(w.z, b.roughness);
}

template <bool kExtended>
inline float average_facet_albedo(const Bsdf& b) {
  if constexpr (kExtended) {
    const ExtendedLobes& x = *b.extended;
    if (x.alpha_t > 0) return x.anisotropic->average(b.roughness, x.anisotropy);
  }
  return b.reflector->average(b.roughness);
}

/// Reflection and transmission of the dielectric layer at cosine `c` to its facets.
struct Layer {
  Vec3f reflect;  // Fresnel term times its weight
  Vec3f pass;     // transmitted to the base below
};

/// Layer with a thin film. From inside a solid, the film sees the angle outside.
inline Layer layer_under_film(const Bsdf& b, float c) {
  const ThinFilm& film = b.extended->film;
  Vec3f f = schlick(b.f0, c);
  float outside = c;
  if (b.interface == Interface::solid) {
    const float exact = fresnel_dielectric(c, b.eta), normal = f0_from_ior(b.eta);
    if (exact >= 1) return {{1, 1, 1}, {}};
    f = b.f0 + (Vec3f{1, 1, 1} - b.f0) * ((exact - normal) / (1 - normal));
    if (b.eta < 1) outside = std::sqrt((b.eta - 1) * (b.eta + 1) + c * c) / b.eta;
  }
  f = lerp(f, thin_film_reflectance(film, b.f0, outside), film.weight);
  const Vec3f reflect = f * b.specular_weight;
  const float pass = 1 - max_component(reflect);
  return {reflect, {pass, pass, pass}};
}

/// Fresnel term with `f0` instead of the reflectance that index `eta` has at normal incidence,
/// derived from its exact term: 1 at grazing angles and in total reflection.
inline Vec3f shifted_fresnel(const Vec3f& f0, float exact, float eta) {
  const float normal = f0_from_ior(eta);
  return f0 + (Vec3f{1, 1, 1} - f0) * ((exact - normal) / (1 - normal));
}

template <bool kExtended>
inline Layer layer_at(const Bsdf& b, float c) {
  if constexpr (kExtended) {
    if (b.extended->film.weight > 0) return layer_under_film(b, c);
  }
  Vec3f f;
  if (b.interface == Interface::solid) {
    const float exact = fresnel_dielectric(c, b.eta);
    if (b.plain_fresnel || exact >= 1)
      return {{exact, exact, exact}, {1 - exact, 1 - exact, 1 - exact}};
    f = shifted_fresnel(b.f0, exact, b.eta);
  } else {
    f = schlick(b.f0, c);
    if constexpr (kExtended) {
      const float ior = b.extended->exact_ior;
      if (ior > 0) f = shifted_fresnel(b.f0, fresnel_dielectric(c, ior), ior);
    }
  }
  const Vec3f reflect = f * b.specular_weight;
  if (b.channelwise) return {reflect, Vec3f{1, 1, 1} - reflect};
  const float pass = 1 - max_component(reflect);
  return {reflect, {pass, pass, pass}};
}

/// Transmission of a solid's layer for light spread diffusely on the side of `wi`: its Fresnel
/// terms in both directions, the second normalised, so that exactly the transmitted light is
/// spread. Inside, evaluating the layer at the half vector would also transmit light that is
/// totally reflected.
template <bool kExtended>
inline Vec3f pass_of_solid(const Bsdf& b, const Vec3f& wi) {
  const bool is_dense = (b.eta < 1) == (wi.z > 0);  // the side of wi
  const float n2 = b.eta < 1 ? 1 / (b.eta * b.eta) : b.eta * b.eta;
  const float mean = is_dense ? b.dense_mean : b.dense_mean * n2;
  const float exact = fresnel_dielectric(std::fabs(wi.z), wi.z > 0 ? b.eta : 1 / b.eta);
  return layer_at<kExtended>(b, b.wo.z).pass * ((1 - exact) / mean);
}

/// Index of the denser side over the other's, if the diffuse lobe on the side of the viewer (or the
/// other, if not `same_side`) is on the denser side of a solid's surface, where light fills only
/// the critical cone; otherwise 1.
inline float cone_index(const Bsdf& b, bool same_side) {
  if (b.interface != Interface::solid || (b.eta < 1) != same_side) return 1;
  if (same_side && b.metallic > 0) return 1;  // the metal's part of the lobe fills the hemisphere
  return b.eta < 1 ? 1 / b.eta : b.eta;
}

/// Density of spread_direction() for a cosine `z` > 0.
inline float spread_density(float z, float index) {
  const float eta = 1 / index;
  return (eta - 1) * (eta + 1) + z * z > 0 ? index * index * kInvPi * z : 0;
}

/// Samples a direction with a density proportional to its cosine, within the cone into which a
/// smooth surface refracts light from the other side: samples there, then refracts.
inline Vec3f spread_direction(const Vec2f& u, float index) {
  Vec3f w = warp::cosine_hemisphere(u);
  if (index == 1) return w;
  w.x /= index;
  w.y /= index;
  w.z = std::sqrt(1 - (w.x * w.x + w.y * w.y));
  return w;
}

inline bool transmits(const Bsdf& b) {
  return b.interface != Interface::opaque && max_component(b.transmit) > 0;
}

/// Reflectance of a conductor, tinted by the base colour, which is metal_f0.
inline Vec3f conductor_reflectance(const Bsdf& b, float c) {
  const Conductor& m = b.extended->conductor;
  return b.metal_f0 * Vec3f{fresnel_conductor(c, m.n.x, m.k.x), fresnel_conductor(c, m.n.y, m.k.y),
                            fresnel_conductor(c, m.n.z, m.k.z)};
}

template <bool kExtended>
inline Vec3f metal_reflectance(const Bsdf& b, float c) {
  if constexpr (kExtended) {
    const ThinFilm& film = b.extended->film;
    const bool conductor = b.extended->conductor.present;
    const Vec3f f = conductor ? conductor_reflectance(b, c) : schlick(b.metal_f0, c);
    if (!(film.weight > 0)) return f;
    const Vec3f f0 = conductor ? conductor_reflectance(b, 1) : b.metal_f0;
    return lerp(f, thin_film_reflectance(film, f0, c), film.weight);
  }
  return schlick(b.metal_f0, c);
}

/// Mean of metal_reflectance() over the cosine-weighted hemisphere; with a film, its value at the
/// mean cosine.
template <bool kExtended>
inline Vec3f average_metal_reflectance(const Bsdf& b) {
  if constexpr (kExtended) {
    const ExtendedLobes& x = *b.extended;
    const Vec3f f =
        x.conductor.present ? b.metal_f0 * x.conductor.average : schlick_average(b.metal_f0);
    if (!(x.film.weight > 0)) return f;
    const Vec3f f0 = x.conductor.present ? conductor_reflectance(b, 1) : b.metal_f0;
    return lerp(f, thin_film_reflectance(x.film, f0, 2.0f / 3), x.film.weight);
  }
  return schlick_average(b.metal_f0);
}

/// Reflectance of the facets at cosine c, dielectric and metal combined.
template <bool kExtended>
inline Vec3f facet_reflectance(const Bsdf& b, const Layer& layer, float c) {
  const Vec3f dielectric = layer.reflect * ((1 - b.metallic) * b.reflect_gain);
  return b.metallic > 0 ? dielectric + metal_reflectance<kExtended>(b, c) * b.metallic : dielectric;
}

/// Probability that draw() reflects at a facet; otherwise it transmits.
template <bool kExtended>
inline float reflect_probability(const Bsdf& b, const Layer& layer, float c) {
  if (!transmits(b) || (b.interface == Interface::thin && b.mirror)) return 1;
  const float reflected = luminance(facet_reflectance<kExtended>(b, layer, c));
  const float passed = luminance(b.transmit * layer.pass);
  const float sum = reflected + passed;
  return sum > 0 ? reflected / sum : 1;
}

inline Vec3f to_world(const BsdfFrame& f, const Vec3f& w) {
  return f.tangent * w.x + f.bitangent * w.y + f.normal * w.z;
}
inline Vec3f to_local(const BsdfFrame& f, const Vec3f& w) {
  return {dot(f.tangent, w), dot(f.bitangent, w), dot(f.normal, w)};
}

}  // namespace tessera::render::base_bsdf
