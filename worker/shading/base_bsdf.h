#pragma once

#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"
#include "worker/shading/anisotropic_albedo.h"
#include "worker/shading/bsdf.h"
#include "worker/shading/fresnel.h"
#include "worker/shading/microfacet.h"

/// The specification's own layers: diffuse, dielectric facets, metal, transmission. For bsdf.cpp
/// and extended_bsdf.cpp only. Everything is made twice: with kExtended for materials that have
/// `extended` lobes, and without for the others, which pay nothing for them. Directions are in the
/// shading frame where nothing else is said.
namespace tessera::render::base_bsdf {

using warp::kInvPi;
inline constexpr float kMatchedIndices = 1e-4f;  // |eta - 1| below which facets do not bend light

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

/// The root in Smith's term, for `w` on either side.
template <bool kExtended>
inline float facet_root(const Bsdf& b, const Vec3f& w) {
  if constexpr (kExtended) {
    if (b.extended->alpha_t > 0) return smith_root(w, b.extended->alpha_t, b.alpha);
  }
  return smith_root(w.z, b.alpha);
}

/// What perfectly reflecting facets keep of light that leaves along `w` after one bounce.
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

/// What the dielectric layer does with light that meets its facets at cosine `c`.
struct Layer {
  Vec3f reflect;  // Fresnel term times its weight
  Vec3f pass;     // what is left for the base below
};

/// Under a thin film. From the inside of a solid, the film is met at the angle outside.
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
    const float normal = f0_from_ior(b.eta);
    f = b.f0 + (Vec3f{1, 1, 1} - b.f0) * ((exact - normal) / (1 - normal));
  } else {
    f = schlick(b.f0, c);
  }
  const Vec3f reflect = f * b.specular_weight;
  if (b.channelwise) return {reflect, Vec3f{1, 1, 1} - reflect};
  const float pass = 1 - max_component(reflect);
  return {reflect, {pass, pass, pass}};
}

inline bool transmits(const Bsdf& b) {
  return b.interface != Interface::opaque && max_component(b.transmit) > 0;
}

template <bool kExtended>
inline Vec3f metal_reflectance(const Bsdf& b, float c) {
  const Vec3f f = schlick(b.metal_f0, c);
  if constexpr (kExtended) {
    const ThinFilm& film = b.extended->film;
    if (film.weight > 0) {
      return lerp(f, thin_film_reflectance(film, b.metal_f0, c), film.weight);
    }
  }
  return f;
}

/// Its mean over the cosine-weighted hemisphere; of a film, its value at the mean cosine.
template <bool kExtended>
inline Vec3f average_metal_reflectance(const Bsdf& b) {
  const Vec3f f = schlick_average(b.metal_f0);
  if constexpr (kExtended) {
    const ThinFilm& film = b.extended->film;
    if (film.weight > 0) {
      return lerp(f, thin_film_reflectance(film, b.metal_f0, 2.0f / 3), film.weight);
    }
  }
  return f;
}

/// Reflected colour of the facets at cosine c: dielectric and metal in their shares.
template <bool kExtended>
inline Vec3f facet_reflectance(const Bsdf& b, const Layer& layer, float c) {
  const Vec3f dielectric = layer.reflect * ((1 - b.metallic) * b.reflect_gain);
  return b.metallic > 0 ? dielectric + metal_reflectance<kExtended>(b, c) * b.metallic : dielectric;
}

/// Probability that draw() reflects at facets it has chosen; the rest is transmitted.
template <bool kExtended>
inline float reflect_probability(const Bsdf& b, const Layer& layer, float c) {
  if (!transmits(b) || (b.interface == Interface::thin && b.mirror)) return 1;
  const float reflected = luminance(facet_reflectance<kExtended>(b, layer, c));
  const float passed = luminance(b.transmit * layer.pass);
  const float sum = reflected + passed;
  return sum > 0 ? reflected / sum : 1;
}

template <bool kExtended>
inline BsdfValue evaluate_reflection(const Bsdf& b, const Vec3f& wi) {
  if (b.lambert) return {b.diffuse * kInvPi * wi.z, wi.z * kInvPi};
  const Vec3f h = direction_of(b.wo + wi);
  const float c = dot(b.wo, h);
  const Layer layer = layer_at<kExtended>(b, c);
  Vec3f f = b.diffuse * layer.pass * kInvPi;
  float pdf = b.cosine_probability * wi.z * kInvPi;
  if constexpr (kExtended) pdf *= 1 - b.extended->back_probability;
  if (!b.mirror) {
    const float d = facet_density<kExtended>(b, h);
    const float v = smith_visibility(b.wo.z, wi.z, b.root_o, facet_root<kExtended>(b, wi));
    f += facet_reflectance<kExtended>(b, layer, c) * (d * v);
    pdf += (1 - b.cosine_probability) * reflect_probability<kExtended>(b, layer, c) *
           visible_normal_density(d, b.wo.z, b.root_o) * 0.25f;
    if (b.metallic > 0) f += b.metal_multiple * (1 - facet_albedo<kExtended>(b, wi));
  }
  return {f * wi.z, pdf};
}

/// A thin rough sheet transmits the mirror image of its reflection lobe.
template <bool kExtended>
inline BsdfValue evaluate_thin(const Bsdf& b, const Vec3f& wi) {
  const float cos_i = -wi.z;
  const Vec3f h = direction_of(b.wo + Vec3f{wi.x, wi.y, cos_i});
  const float c = dot(b.wo, h);
  const Layer layer = layer_at<kExtended>(b, c);
  const float d = facet_density<kExtended>(b, h);
  const float v = smith_visibility(b.wo.z, cos_i, b.root_o, facet_root<kExtended>(b, wi));
  const float pdf = (1 - b.cosine_probability) * (1 - reflect_probability<kExtended>(b, layer, c)) *
                    visible_normal_density(d, b.wo.z, b.root_o) * 0.25f;
  return {b.transmit * layer.pass * (d * v * b.transmit_gain * cos_i), pdf};
}

template <bool kExtended>
inline BsdfValue evaluate_refraction(const Bsdf& b, const Vec3f& wi) {
  const Vec3f sum = b.wo + wi * b.eta;
  const Vec3f h = direction_of(sum.z < 0 ? -sum : sum);
  const float c_o = dot(b.wo, h), c_i = -dot(wi, h);
  if (!(c_o > 0) || !(c_i > 0)) return {};
  const float cos_i = -wi.z;
  const Layer layer = layer_at<kExtended>(b, c_o);
  const float d = facet_density<kExtended>(b, h);
  const float v = smith_visibility(b.wo.z, cos_i, b.root_o, facet_root<kExtended>(b, wi));
  const float ratio = b.eta / (c_o - b.eta * c_i);
  const float jacobian = c_i * (ratio * ratio);
  const float pdf = (1 - b.cosine_probability) *
                    (1 - reflect_probability<kExtended>(b, layer, c_o)) *
                    visible_normal_density(d, b.wo.z, b.root_o) * c_o * jacobian;
  return {b.transmit * layer.pass * (4 * d * v * c_o * jacobian * b.transmit_gain * cos_i), pdf};
}

/// Light spread evenly behind the surface; the dielectric layer takes its share as of light that is
/// spread before it.
inline void add_diffuse_transmission(const Bsdf& b, const Vec3f& wi, BsdfValue* value) {
  const ExtendedLobes& x = *b.extended;
  if (!(x.back_probability > 0)) return;
  const float cos_i = -wi.z;
  const float c = dot(b.wo, direction_of(b.wo + Vec3f{wi.x, wi.y, cos_i}));
  value->f_cos += x.diffuse_transmit * layer_at<true>(b, c).pass * (kInvPi * cos_i);
  value->pdf += b.cosine_probability * x.back_probability * kInvPi * cos_i;
}

/// Value and density for `wi`.
template <bool kExtended>
inline BsdfValue evaluate(const Bsdf& b, const Vec3f& wi) {
  if (wi.z > 0) return evaluate_reflection<kExtended>(b, wi);
  if constexpr (kExtended) {
    BsdfValue value;
    if (!(wi.z < 0)) return value;
    if (!b.mirror && transmits(b)) {
      value = b.interface == Interface::thin ? evaluate_thin<true>(b, wi)
                                             : evaluate_refraction<true>(b, wi);
    }
    add_diffuse_transmission(b, wi, &value);
    return value;
  }
  if (!(wi.z < 0) || b.mirror || !transmits(b)) return {};
  return b.interface == Interface::thin ? evaluate_thin<kExtended>(b, wi)
                                        : evaluate_refraction<kExtended>(b, wi);
}

inline Vec3f to_world(const BsdfFrame& f, const Vec3f& w) {
  return f.tangent * w.x + f.bitangent * w.y + f.normal * w.z;
}
inline Vec3f to_local(const BsdfFrame& f, const Vec3f& w) {
  return {dot(f.tangent, w), dot(f.bitangent, w), dot(f.normal, w)};
}

/// Rough glass: what one scattering keeps of the light; 1 where there is nothing to mend.
template <bool kExtended>
inline float single_scattering_albedo(const Bsdf& b, const BsdfTables& tables, bool front) {
  if (b.mirror || !transmits(b)) return 1;
  if constexpr (kExtended) {
    // Anisotropic refraction has no table: what its facets lose stays lost.
    if (b.extended->alpha_t > 0) {
      return b.interface == Interface::thin ? facet_albedo<true>(b, b.wo) : 1;
    }
  }
  const AlbedoTable* table = b.interface == Interface::thin ? tables.reflector
                             : front                        ? tables.entering
                                                            : tables.leaving;
  return table == nullptr ? 1 : table->at(b.wo.z, b.roughness);
}

/// Kulla & Conty 2017: the light that left the facets only after several bounces, for metals.
template <bool kExtended>
inline Vec3f metal_multiple_scattering(const Bsdf& b) {
  const float average = average_facet_albedo<kExtended>(b);
  const float lost = 1 - average;
  if (!(lost > 0)) return {};
  const Vec3f f = average_metal_reflectance<kExtended>(b);
  const Vec3f colour = f * f * average / (Vec3f{1, 1, 1} - f * lost);
  return colour * (b.metallic * kInvPi * (1 - facet_albedo<kExtended>(b, b.wo)) / lost);
}

/// Sets the probability of the cosine lobe from the energies both lobes are likely to carry.
template <bool kExtended>
inline void choose_lobes(Bsdf* b) {
  const Layer layer = layer_at<kExtended>(*b, b->wo.z);
  float cosine = luminance(b->diffuse * layer.pass);
  if (b->metallic > 0 && !b->mirror) {
    cosine += luminance(b->metal_multiple) * (1 - average_facet_albedo<kExtended>(*b)) / kInvPi;
  }
  if constexpr (kExtended) {
    ExtendedLobes& x = *b->extended;
    const float back = luminance(x.diffuse_transmit * layer.pass);
    cosine += back;
    x.back_probability = back > 0 ? back / cosine : 0;
  }
  float facets = luminance(facet_reflectance<kExtended>(*b, layer, b->wo.z));
  if (transmits(*b) && !(b->mirror && b->interface == Interface::thin)) {
    facets += luminance(b->transmit * layer.pass);
  }
  if (!(facets > 0)) {
    b->cosine_probability = 1;
  } else if (!(cosine > 0)) {
    b->cosine_probability = 0;
  } else {
    b->cosine_probability = clamp(cosine / (cosine + facets), 0.05f, 0.95f);
  }
}

/// Gives part of the diffuse lobe, whose share of all light is `weight`, to the one behind the
/// surface.
inline void transmit_diffusely(const BsdfExtensions& e, float weight, Interface interface,
                               Bsdf* b) {
  b->extended->diffuse_transmit = e.diffuse_transmission_color * (weight * e.diffuse_transmission);
  b->diffuse *= 1 - e.diffuse_transmission;
  b->interface = interface;
}

/// Makes the facets anisotropic: rougher along the tangent.
inline void stretch(float anisotropy, const BsdfTables& tables, Bsdf* b) {
  ExtendedLobes& x = *b->extended;
  const float alpha = b->alpha > kMirrorAlpha ? b->alpha : kMirrorAlpha;
  const float alpha_t = anisotropic_alpha(alpha, anisotropy);
  if (!(alpha_t > kMirrorAlpha)) return;
  b->alpha = alpha;
  x.alpha_t = alpha_t;
  x.anisotropy = anisotropy;
  x.anisotropic = tables.anisotropic;
}

/// Fills `b` but for what lies over the base; see make_bsdf(). `extensions` may be null without
/// kExtended.
template <bool kExtended>
inline void prepare(const BsdfParameters& p, const BsdfExtensions* extensions,
                    const BsdfTables& tables, const BsdfFrame& frame, const Vec3f& wo, Bsdf* out) {
  Bsdf& b = *out;
  if constexpr (kExtended) b.extended.emplace();
  b.frame = frame;
  b.wo = to_local(frame, wo);
  if (b.wo.z < 1e-6f) b.wo.z = 1e-6f;  // rounding only: frame and wo share a side
  const float dielectric = 1 - p.metallic;
  const bool transmissive = p.interface != Interface::opaque && p.transmission > 0;
  b.interface = transmissive ? p.interface : Interface::opaque;
  const float transmission = transmissive ? p.transmission : 0;
  b.diffuse = p.base * (dielectric * (1 - transmission));
  b.transmit = p.base * (dielectric * transmission);
  b.f0 = p.f0;
  b.specular_weight = p.specular_weight;
  b.metallic = p.metallic;
  b.metal_f0 = p.base;
  bool passes_back = false;
  if constexpr (kExtended) {
    passes_back = p.interface != Interface::opaque && extensions->diffuse_transmission > 0;
    if (passes_back)
      transmit_diffusely(*extensions, dielectric * (1 - transmission), p.interface, &b);
    b.extended->film = extensions->film;
  }
  if (!transmissive && p.metallic == 0 && p.specular_weight == 0 && !passes_back) {
    b.lambert = true;
    return;
  }
  b.roughness = p.roughness;
  b.alpha = p.roughness * p.roughness;
  b.channelwise = p.specular_glossiness;
  b.reflector = tables.reflector;
  if (b.interface == Interface::solid) {
    b.eta = p.front ? p.ior : 1 / p.ior;
    const float f0 = f0_from_ior(p.ior);
    b.plain_fresnel = p.specular_weight == 1 && p.f0 == Vec3f{f0, f0, f0};
    if (!(p.ior > 0)) b.interface = Interface::opaque;  // ior 0: everything is reflected, F = 1
    if (b.eta > 1 - kMatchedIndices && b.eta < 1 + kMatchedIndices) b.alpha = 0;
  }
  if constexpr (kExtended) {
    const bool matched = b.alpha == 0 && p.roughness > 0;
    if (extensions->anisotropy > 0 && !matched) stretch(extensions->anisotropy, tables, &b);
  }
  b.mirror = b.alpha < kMirrorAlpha;
  b.root_o = facet_root<kExtended>(b, b.wo);
  const float kept = single_scattering_albedo<kExtended>(b, tables, p.front);
  b.transmit_gain = 1 / kept;
  b.reflect_gain = lerp(1.0f, b.transmit_gain, transmission);
  if (b.metallic > 0 && !b.mirror) b.metal_multiple = metal_multiple_scattering<kExtended>(b);
  choose_lobes<kExtended>(&b);
}

template <bool kExtended>
inline Vec3f sample_facet(const Bsdf& b, const Vec2f& circle, float u) {
  if constexpr (kExtended) {
    const float alpha_t = b.extended->alpha_t;
    if (alpha_t > 0) return sample_visible_normal(b.wo, alpha_t, b.alpha, circle.x, circle.y, u);
  }
  return sample_visible_normal(b.wo, b.alpha, circle.x, circle.y, u);
}

/// The direction a facet with normal `h` sends light to; false if it is lost.
inline bool scatter_at_facet(const Bsdf& b, const Vec3f& h, bool reflect, Vec3f* wi) {
  const float c = dot(b.wo, h);
  if (reflect) {
    *wi = h * (2 * c) - b.wo;
    return wi->z > 0;
  }
  if (b.interface == Interface::thin) {
    const Vec3f mirrored = h * (2 * c) - b.wo;
    *wi = {mirrored.x, mirrored.y, -mirrored.z};
    return wi->z < 0;
  }
  return refract(b.wo, h, b.eta, wi) && wi->z < 0;
}

/// `w` (world) mirrored in the surface.
inline Vec3f mirrored_in_surface(const BsdfFrame& frame, const Vec3f& w) {
  const Vec3f& n = frame.geometric_normal;
  return direction_of(n * (2 * dot(w, n)) - w);
}

/// Where interpolated normals would send a mirror-smooth lobe to the wrong side of the surface, the
/// facet is taken to lie in the surface: no light is lost at the rims of smooth glass.
inline bool turn_to_its_side(const Bsdf& b, BsdfSample* sample) {
  const Vec3f& n = b.frame.geometric_normal;
  const Vec3f wo = to_world(b.frame, b.wo);
  if (sample->transmitted) return refract(wo, n, b.eta, &sample->wi);
  sample->wi = mirrored_in_surface(b.frame, wo);
  return dot(sample->wi, n) > 0;
}

/// Draws a direction as sample_bsdf() does, also in the frame as `local`; of a delta lobe, its
/// weight. False when it is lost.
template <bool kExtended>
inline bool draw(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample, Vec3f* local) {
  if (u_lobe < b.cosine_probability) {
    *local = warp::cosine_hemisphere(u);
    if (!(local->z > 0)) return false;
    sample->transmitted = sample->delta = false;
    if constexpr (kExtended) {
      sample->transmitted = u_lobe < b.cosine_probability * b.extended->back_probability;
      if (sample->transmitted) local->z = -local->z;
    }
  } else {
    const float p_facets = 1 - b.cosine_probability;
    const float u_side = (u_lobe - b.cosine_probability) / p_facets;
    Vec3f h{0, 0, 1};
    if (!b.mirror) {
      const Vec2f circle = point_on_circle(u.x);
      h = sample_facet<kExtended>(b, circle, u.y);
    }
    const float c = dot(b.wo, h);
    const Layer layer = layer_at<kExtended>(b, c);
    const float p_reflect = reflect_probability<kExtended>(b, layer, c);
    const bool reflect = u_side < p_reflect;
    if (!scatter_at_facet(b, h, reflect, local)) return false;
    sample->transmitted = !reflect;
    sample->delta = b.mirror;
    if (b.mirror) {
      sample->weight = reflect ? facet_reflectance<kExtended>(b, layer, c) / (p_facets * p_reflect)
                               : b.transmit * layer.pass / (p_facets * (1 - p_reflect));
    }
  }
  sample->wi = direction_of(to_world(b.frame, *local));
  if ((dot(sample->wi, b.frame.geometric_normal) > 0) == sample->transmitted) {
    return sample->delta && turn_to_its_side(b, sample);
  }
  return true;
}

template <bool kExtended>
inline Vec3f straight_transmittance(const Bsdf& b) {
  if (!b.mirror || b.interface != Interface::thin) return {};
  return b.transmit * layer_at<kExtended>(b, b.wo.z).pass;
}

/// Estimate of what draw() scatters.
template <bool kExtended>
inline float scattered_albedo(const Bsdf& b) {
  const Layer layer = layer_at<kExtended>(b, b.wo.z);
  float behind = 0;
  if constexpr (kExtended) behind = luminance(b.extended->diffuse_transmit * layer.pass);
  return behind + luminance(b.diffuse * layer.pass) +
         luminance(facet_reflectance<kExtended>(b, layer, b.wo.z));
}

template <bool kExtended>
inline bool has_smooth_density(const Bsdf& b) {
  if constexpr (kExtended) {
    if (b.extended->back_probability > 0) return true;
  }
  return (!b.mirror && !b.lambert) || max_component(b.diffuse) > 0;
}

}  // namespace tessera::render::base_bsdf
