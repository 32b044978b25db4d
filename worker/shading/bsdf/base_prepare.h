#pragma once

#include "worker/shading/bsdf/base_facets.h"

/// Preparation of the base of a Bsdf for one viewer. Used by bsdf.cpp and extended_bsdf.cpp only.
namespace tessera::render::base_bsdf {

/// Single-scattering albedo of rough glass; 1 if no energy is lost.
template <bool kExtended>
inline float single_scattering_albedo(const Bsdf& b, const BsdfTables& tables, bool front) {
  if (b.mirror || !transmits(b)) return 1;
  if constexpr (kExtended) {
    // There is no table for anisotropic refraction; its lost energy is not compensated.
    if (b.extended->alpha_t > 0) {
      return b.interface == Interface::thin ? facet_albedo<true>(b, b.wo) : 1;
    }
  }
  const AlbedoTable* table = b.interface == Interface::thin ? tables.reflector
                             : front                        ? tables.entering
                                                            : tables.leaving;
  return table == nullptr ? 1 : table->at(b.wo.z, b.roughness);
}

/// Multiple-scattering term of metals (Kulla & Conty 2017).
template <bool kExtended>
inline Vec3f metal_multiple_scattering(const Bsdf& b) {
  const float average = average_facet_albedo<kExtended>(b);
  const float lost = 1 - average;
  if (!(lost > 0)) return {};
  const Vec3f f = average_metal_reflectance<kExtended>(b);
  const Vec3f colour = f * f * average / (Vec3f{1, 1, 1} - f * lost);
  return colour * (b.metallic * kInvPi * (1 - facet_albedo<kExtended>(b, b.wo)) / lost);
}

/// Sets the probability of the cosine lobe from the estimated energy of both lobes.
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

/// Moves part of the diffuse lobe, with total weight `weight`, to the other side of the surface.
inline void transmit_diffusely(const BsdfExtensions& e, float weight, Interface interface,
                               Bsdf* b) {
  b->extended->diffuse_transmit = e.diffuse_transmission_color * (weight * e.diffuse_transmission);
  b->diffuse *= 1 - e.diffuse_transmission;
  b->interface = interface;
}

/// Makes the facets anisotropic, rougher along the tangent.
inline void set_anisotropy(float anisotropy, const BsdfTables& tables, Bsdf* b) {
  ExtendedLobes& x = *b->extended;
  const float alpha = b->alpha > kMirrorAlpha ? b->alpha : kMirrorAlpha;
  const float alpha_t = anisotropic_alpha(alpha, anisotropy);
  if (!(alpha_t > kMirrorAlpha)) return;
  b->alpha = alpha;
  x.alpha_t = alpha_t;
  x.anisotropy = anisotropy;
  x.anisotropic = tables.anisotropic;
}

inline void set_viewer(const BsdfFrame& frame, const Vec3f& wo, Bsdf* b) {
  b->frame = frame;
  b->wo = to_local(frame, wo);
  if (b->wo.z < 1e-6f) b->wo.z = 1e-6f;  // rounding only: frame and wo share a side
}

/// Fills the base layers of `b`; see make_bsdf(). `extensions` may be null without kExtended.
template <bool kExtended>
inline void prepare(const BsdfParameters& p, const BsdfExtensions* extensions,
                    const BsdfTables& tables, const BsdfFrame& frame, const Vec3f& wo, Bsdf* out) {
  Bsdf& b = *out;
  if constexpr (kExtended) b.extended.emplace();
  set_viewer(frame, wo, &b);
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
  bool passes_back = false, rough = false;
  if constexpr (kExtended) {
    rough = extensions->diffuse_roughness > 0;
    if (rough)
      b.extended->rough = make_rough_diffuse(p.base, extensions->diffuse_roughness, b.wo.z);
    b.extended->conductor = extensions->conductor;
    if (extensions->exact_fresnel) b.extended->exact_ior = p.ior;
    passes_back = p.interface != Interface::opaque && extensions->diffuse_transmission > 0;
    if (passes_back)
      transmit_diffusely(*extensions, dielectric * (1 - transmission), p.interface, &b);
    b.extended->film = extensions->film;
  }
  if (!transmissive && p.metallic == 0 && p.specular_weight == 0 && !passes_back && !rough) {
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
    if (passes_back || max_component(b.diffuse) > 0) {
      b.dense_mean = mean_transmittance_from_dense(p.ior);
    }
  }
  if constexpr (kExtended) {
    const bool matched = b.alpha == 0 && p.roughness > 0;
    if (extensions->anisotropy > 0 && !matched) set_anisotropy(extensions->anisotropy, tables, &b);
  }
  b.mirror = b.alpha < kMirrorAlpha;
  b.root_o = facet_root<kExtended>(b, b.wo);
  const float kept = single_scattering_albedo<kExtended>(b, tables, p.front);
  b.transmit_gain = 1 / kept;
  b.reflect_gain = lerp(1.0f, b.transmit_gain, transmission);
  if (b.metallic > 0 && !b.mirror) b.metal_multiple = metal_multiple_scattering<kExtended>(b);
  choose_lobes<kExtended>(&b);
}

}  // namespace tessera::render::base_bsdf
