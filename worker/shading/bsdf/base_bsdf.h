#pragma once

#include "worker/shading/bsdf/base_coupling.h"
#include "worker/shading/bsdf/base_facets.h"

/// Base layers of the specification: diffuse, dielectric microfacets, metal, transmission. Used by
/// bsdf.cpp and extended_bsdf.cpp only. Instantiated with kExtended for materials with `extended`
/// lobes, and without it for others, which then pay nothing for them. Directions are in the shading
/// frame unless noted.
namespace tessera::render::base_bsdf {

template <bool kExtended>
inline BsdfValue evaluate_reflection(const Bsdf& b, const Vec3f& wi) {
  if (b.lambert) return {b.diffuse * kInvPi * wi.z, wi.z * kInvPi};
  const Vec3f h = direction_of(b.wo + wi);
  const float c = dot(b.wo, h);
  const Layer layer = layer_at<kExtended>(b, c);
  Vec3f f;
  if (max_component(b.coupled) > 0) f = b.coupled * passed_to_base<kExtended>(b, wi);
  if constexpr (kExtended) {
    if (b.extended->rough.roughness > 0) f *= rough_diffuse(b.extended->rough, b.wo, wi);
  }
  float pdf = b.cosine_probability * spread_of(b, true).density(wi.z);
  if constexpr (kExtended) pdf *= 1 - b.extended->back_probability;
  if (!b.mirror) {
    const float d = facet_density<kExtended>(b, h);
    const float v = smith_visibility(b.wo.z, wi.z, b.root_o, facet_root<kExtended>(b, wi));
    f += facet_reflectance<kExtended>(b, layer, c) * (d * v);
    pdf += (1 - b.cosine_probability) * reflect_probability<kExtended>(b, layer, c) *
           visible_normal_density(d, b.wo.z, b.root_o) * 0.25f;
    if (b.metallic > 0) {
      const FacetAlbedo e = facet_albedo<kExtended>(b, wi);
      const float lost = 1 - (e.a + e.b);
      if (lost > 0) f += b.metal_multiple * lost;
    }
  }
  return {f * wi.z, pdf};
}

/// A thin rough surface transmits the mirror image of its reflection lobe.
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

/// Adds the diffuse lobe on the other side of the surface. The dielectric layer of a thin surface
/// attenuates it like the diffuse lobe on the viewer's side.
inline void add_diffuse_transmission(const Bsdf& b, const Vec3f& wi, BsdfValue* value) {
  const ExtendedLobes& x = *b.extended;
  if (!(x.back_probability > 0)) return;
  const float cos_i = -wi.z;
  const bool solid = b.interface == Interface::solid;
  const Vec3f seen_by_layer = solid ? wi : Vec3f{wi.x, wi.y, cos_i};
  value->f_cos += x.diffuse_transmit * passed_to_base<true>(b, seen_by_layer) * cos_i;
  value->pdf += b.cosine_probability * x.back_probability * spread_of(b, false).density(cos_i);
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

template <bool kExtended>
inline Vec3f sample_facet(const Bsdf& b, const Vec2f& circle, float u) {
  if constexpr (kExtended) {
    const float alpha_t = b.extended->alpha_t;
    if (alpha_t > 0) return sample_visible_normal(b.wo, alpha_t, b.alpha, circle.x, circle.y, u);
  }
  return sample_visible_normal(b.wo, b.alpha, circle.x, circle.y, u);
}

/// Direction into which a facet with normal `h` scatters; false if the sample is lost.
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

/// `w` (world) mirrored at the surface.
inline Vec3f mirrored_in_surface(const BsdfFrame& frame, const Vec3f& w) {
  const Vec3f& n = frame.geometric_normal;
  return direction_of(n * (2 * dot(w, n)) - w);
}

/// Redirects a specular sample that the interpolated normal sends to the wrong side of the surface,
/// using the geometric normal instead, so that rims of smooth glass lose no light.
inline bool use_geometric_normal(const Bsdf& b, BsdfSample* sample) {
  const Vec3f& n = b.frame.geometric_normal;
  const Vec3f wo = to_world(b.frame, b.wo);
  if (sample->transmitted) return refract(wo, n, b.eta, &sample->wi);
  sample->wi = mirrored_in_surface(b.frame, wo);
  return dot(sample->wi, n) > 0;
}

/// Samples a direction as sample_bsdf() does, also in the frame as `local`; sets the weight of a
/// delta lobe. False if the sample is lost.
template <bool kExtended>
inline bool draw(const Bsdf& b, float u_lobe, const Vec2f& u, BsdfSample* sample, Vec3f* local) {
  if (u_lobe < b.cosine_probability) {
    sample->transmitted = sample->delta = false;
    if constexpr (kExtended) {
      sample->transmitted = u_lobe < b.cosine_probability * b.extended->back_probability;
    }
    *local = spread_of(b, !sample->transmitted).direction(u);
    if (!(local->z > 0)) return false;
    if (sample->transmitted) local->z = -local->z;
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
      sample->lobe = reflect ? DeltaLobe::reflection : DeltaLobe::refraction;
      sample->weight = reflect ? facet_reflectance<kExtended>(b, layer, c) / (p_facets * p_reflect)
                               : b.transmit * layer.pass / (p_facets * (1 - p_reflect));
    }
  }
  sample->wi = direction_of(to_world(b.frame, *local));
  if ((dot(sample->wi, b.frame.geometric_normal) > 0) == sample->transmitted) {
    return sample->delta && use_geometric_normal(b, sample);
  }
  return true;
}

template <bool kExtended>
inline Vec3f straight_transmittance(const Bsdf& b) {
  if (!b.mirror || b.interface != Interface::thin) return {};
  return b.transmit * layer_at<kExtended>(b, b.wo.z).pass;
}

/// Estimated albedo of draw().
template <bool kExtended>
inline float scattered_albedo(const Bsdf& b) {
  const Layer layer = layer_at<kExtended>(b, b.wo.z);
  float behind = 0;
  if constexpr (kExtended) behind = b.extended->behind_albedo;
  return behind + b.diffuse_albedo + luminance(facet_reflectance<kExtended>(b, layer, b.wo.z));
}

/// A value of u_lobe with which draw() samples a delta lobe, and its probability; 0 if the base has
/// no such lobe.
struct LobeChoice {
  float u_lobe = 0, probability = 0;
};

template <bool kExtended>
inline LobeChoice choice_of(const Bsdf& b, DeltaLobe lobe) {
  if (!b.mirror || lobe == DeltaLobe::coat) return {};
  const float p_reflect = reflect_probability<kExtended>(b, layer_at<kExtended>(b, b.wo.z), b.wo.z);
  const float p_facets = 1 - b.cosine_probability;
  if (lobe == DeltaLobe::reflection)
    return {b.cosine_probability + p_facets * (p_reflect * 0.5f), p_facets * p_reflect};
  return {b.cosine_probability + p_facets * (0.5f + p_reflect * 0.5f), p_facets * (1 - p_reflect)};
}

template <bool kExtended>
inline bool has_smooth_density(const Bsdf& b) {
  if constexpr (kExtended) {
    if (b.extended->back_probability > 0) return true;
  }
  return (!b.mirror && !b.lambert) || max_component(b.diffuse) > 0;
}

}  // namespace tessera::render::base_bsdf
