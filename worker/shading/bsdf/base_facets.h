#pragma once

#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/microfacet/fresnel.h"
#include "worker/shading/microfacet/microfacet.h"

/// Microfacet and Fresnel terms of the base, with and without extensions. Used by the other
/// base_*.h only.
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

/// Albedo of the facets for light leaving along `w`, on either side. Requires a rough lobe.
template <bool kExtended>
inline FacetAlbedo facet_albedo(const Bsdf& b, const Vec3f& w) {
  if constexpr (kExtended) {
    if (b.extended->alpha_t > 0) return b.extended->anisotropic.at(w);
  }
  return render::facet_albedo(b.facets, std::fabs(w.z));
}

template <bool kExtended>
inline FacetAlbedo mean_facet_albedo(const Bsdf& b) {
  if constexpr (kExtended) {
    if (b.extended->alpha_t > 0) return b.extended->anisotropic.mean();
  }
  return render::mean_facet_albedo(b.facets);
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

/// Density of the cosine lobe on one side of a surface. On the denser side of a solid, the critical
/// cone gets the share 1 - roughness: a smooth surface lets nothing else pass.
struct Spread {
  float index = 1;  // of the denser side over the other, if this is the denser one; otherwise 1
  float share = 0;  // of the cone

  float density(float z) const {
    if (index == 1) return z * kInvPi;
    const float eta = 1 / index;
    const float cone = (eta - 1) * (eta + 1) + z * z > 0 ? share * (index * index) : 0;
    return (cone + (1 - share)) * z * kInvPi;
  }

  /// Samples a direction. Those in the cone are sampled on the other side, then refracted.
  Vec3f direction(const Vec2f& u) const {
    if (index == 1) return warp::cosine_hemisphere(u);
    if (!(u.x < share)) return warp::cosine_hemisphere({(u.x - share) / (1 - share), u.y});
    Vec3f w = warp::cosine_hemisphere({u.x / share, u.y});
    w.x /= index;
    w.y /= index;
    w.z = std::sqrt(1 - (w.x * w.x + w.y * w.y));
    return w;
  }
};

/// The cosine lobe on the side of the viewer, or on the other if not `same_side`.
inline Spread spread_of(const Bsdf& b, bool same_side) {
  if (b.interface != Interface::solid || (b.eta < 1) != same_side) return {};
  if (same_side && b.metallic > 0) return {};  // the metal's part of the lobe fills the hemisphere
  return {b.eta < 1 ? 1 / b.eta : b.eta, b.mirror ? 1 : 1 - b.roughness};
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
