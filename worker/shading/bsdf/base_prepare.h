#pragma once

#include "worker/shading/bsdf/base_coupling.h"
#include "worker/shading/bsdf/base_facets.h"

/// Preparation of the base of a Bsdf for one viewer. Used by bsdf.cpp and extended_bsdf.cpp only.
namespace tessera::render::base_bsdf {

/// Single-scattering albedo of rough glass; 1 if no energy is lost.
template <bool kExtended>
inline float single_scattering_albedo(const Bsdf& b, const GlassTable* table) {
  if (b.mirror || !transmits(b)) return 1;
  if (b.interface == Interface::thin) {
    const FacetAlbedo e = facet_albedo<kExtended>(b, b.wo);
    return e.a + e.b;
  }
  if constexpr (kExtended) {
    // There is no table for anisotropic refraction; its lost energy is not compensated.
    if (b.extended->alpha_t > 0) return 1;
  }
  if (table == nullptr) return 1;
  const ScatteredAlbedo e = table->scattered(b.wo.z, b.roughness);
  if constexpr (kExtended) {
    if (b.extended->film.weight > 0) return e.most;
  }
  const float w = b.specular_weight, albedo = e.at(w * max_component(b.f0), w);
  if (!b.channelwise) return albedo;
  const float least = b.f0.x < b.f0.y ? b.f0.x : b.f0.y;
  const float other = e.at(w * (least < b.f0.z ? least : b.f0.z), w);
  return other > albedo ? other : albedo;
}

/// Multiple-scattering term of metals (Kulla & Conty 2017).
template <bool kExtended>
inline Vec3f metal_multiple_scattering(const Bsdf& b, float lost) {
  if (!(lost > 0)) return {};
  const FacetAlbedo towards = facet_albedo<kExtended>(b, b.wo);
  const float from_o = 1 - (towards.a + towards.b);
  if (!(from_o > 0)) return {};
  const Vec3f f = average_metal_reflectance<kExtended>(b);
  const Vec3f colour = f * f * (1 - lost) / (Vec3f{1, 1, 1} - f * lost);
  return colour * (b.metallic * kInvPi * from_o / lost);
}

/// Part of the light that perfectly reflecting facets lose, on average.
template <bool kExtended>
inline float lost_by_facets(const Bsdf& b) {
  const FacetAlbedo mean = mean_facet_albedo<kExtended>(b);
  return 1 - (mean.a + mean.b);
}

/// Sets the probability of the cosine lobe from the estimated energy of both lobes. `lost` is
/// lost_by_facets() of a metal.
template <bool kExtended>
inline void choose_lobes(float lost, Bsdf* b) {
  const Layer layer = layer_at<kExtended>(*b, b->wo.z);
  float cosine = b->diffuse_albedo;
  if (b->metallic > 0 && !b->mirror) cosine += luminance(b->metal_multiple) * lost / kInvPi;
  if constexpr (kExtended) {
    ExtendedLobes& x = *b->extended;
    cosine += x.behind_albedo;
    x.back_probability = x.behind_albedo > 0 ? x.behind_albedo / cosine : 0;
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

/// f0 of the layer's albedo, times its weight: the largest channel unless channels are apart. A
/// film counts as the Fresnel term that covers it.
template <bool kExtended>
inline Vec3f cover_f0_of(const Bsdf& b, float ior) {
  Vec3f f0 = b.f0;
  if (!b.channelwise) {
    const float most = max_component(f0);
    f0 = {most, most, most};
  }
  if constexpr (kExtended) {
    const ExtendedLobes& x = *b.extended;
    if (x.film.weight > 0) f0 = lerp(f0, Vec3f{x.film.cap, x.film.cap, x.film.cap}, x.film.weight);
    if (x.alpha_t > 0 && b.interface == Interface::solid) {
      // Anisotropic facets have a table of Schlick's term only: raise f0 until it covers the exact.
      const float normal = f0_from_ior(ior);
      float excess = 0;
      for (int i = 0; i < 16; ++i) {
        const float c = 0.0625f * (static_cast<float>(i) + 0.5f), s = schlick_weight(c);
        const float exact = (fresnel_dielectric(c, ior) - normal) / (1 - normal);
        excess = exact - s > excess * (1 - s) ? (exact - s) / (1 - s) : excess;
      }
      f0 += (Vec3f{1, 1, 1} - f0) * (1.05f * excess);
    }
  }
  return f0 * b.specular_weight;
}

/// Sets the rows of tables that only extended lobes of a solid use.
inline void set_far_tables(const GlassTable* viewer, const GlassTable* far, Bsdf* b) {
  if (b->interface != Interface::solid || viewer == nullptr || far == nullptr) return;
  ExtendedLobes& x = *b->extended;
  x.far_glass = far->row(b->roughness);
  if (x.alpha_t > 0) x.dense_t = (b->eta < 1 ? viewer : far)->row(std::sqrt(x.alpha_t));
}

/// Couples the diffuse lobes with the layer over them; see base_coupling.h. `viewer` and `far` are
/// the tables of both sides, if they are rough and have an exact Fresnel term.
template <bool kExtended>
inline void couple(float ior, const GlassTable* viewer, const GlassTable* far, Bsdf* b) {
  const bool reflects = max_component(b->diffuse) > 0;
  bool passes_back = false;
  if constexpr (kExtended) passes_back = max_component(b->extended->diffuse_transmit) > 0;
  if (!reflects && !passes_back) return;
  b->cover_f0 = cover_f0_of<kExtended>(*b, ior);
  if (viewer != nullptr) b->glass = viewer->row(b->roughness);
  if constexpr (kExtended) set_far_tables(viewer, far, b);
  const Vec3f passed_o = passed(*b, cover_at<kExtended>(*b, b->wo));
  if (reflects) {
    b->coupled = b->diffuse * coupling_factor<kExtended>(*b, passed_o, viewer, true);
    b->diffuse_albedo = luminance(b->diffuse * passed_o);
  }
  if constexpr (kExtended) {
    if (!passes_back) return;
    ExtendedLobes& x = *b->extended;
    x.behind_albedo = luminance(x.diffuse_transmit * passed_o);
    const bool solid = b->interface == Interface::solid;
    x.diffuse_transmit *= solid ? coupling_factor<true>(*b, passed_o, far, false)
                                : coupling_factor<true>(*b, passed_o, viewer, true);
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
inline void set_anisotropy(float anisotropy, Bsdf* b) {
  ExtendedLobes& x = *b->extended;
  const float alpha = b->alpha > kMirrorAlpha ? b->alpha : kMirrorAlpha;
  const float alpha_t = anisotropic_alpha(alpha, anisotropy);
  if (!(alpha_t > kMirrorAlpha)) return;
  b->alpha = alpha;
  x.alpha_t = alpha_t;
  x.anisotropy = anisotropy;
  x.anisotropic = AnisotropicAlbedo(b->roughness, anisotropy);
}

inline void set_viewer(const BsdfFrame& frame, const Vec3f& wo, Bsdf* b) {
  b->frame = frame;
  b->wo = to_local(frame, wo);
  if (b->wo.z < 1e-6f) b->wo.z = 1e-6f;  // rounding only: frame and wo share a side
}

/// Sets the factors and probabilities of the lobes, whose shapes are known.
template <bool kExtended>
inline void set_weights(const BsdfParameters& p, const BsdfTables& tables, float transmission,
                        Bsdf* out) {
  Bsdf& b = *out;
  const bool solid = b.interface == Interface::solid;
  const GlassTable* viewer = solid && !p.front ? tables.leaving : tables.entering;
  const GlassTable* far = p.front ? tables.leaving : tables.entering;
  const float kept = single_scattering_albedo<kExtended>(b, viewer);
  b.transmit_gain = 1 / kept;
  b.reflect_gain = lerp(1.0f, b.transmit_gain, transmission);
  const bool has_table = !b.mirror && exact_eta<kExtended>(b, true) > 0;
  couple<kExtended>(p.ior, has_table ? viewer : nullptr, has_table ? far : nullptr, out);
  float lost = 0;
  if (b.metallic > 0 && !b.mirror) {
    lost = lost_by_facets<kExtended>(b);
    b.metal_multiple = metal_multiple_scattering<kExtended>(b, lost);
  }
  choose_lobes<kExtended>(lost, out);
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
    b.diffuse_albedo = luminance(b.diffuse);
    return;
  }
  b.roughness = p.roughness;
  b.alpha = p.roughness * p.roughness;
  b.channelwise = p.specular_glossiness;
  if (b.interface == Interface::solid) {
    b.eta = p.front ? p.ior : 1 / p.ior;
    const float f0 = f0_from_ior(p.ior);
    b.plain_fresnel = p.specular_weight == 1 && p.f0 == Vec3f{f0, f0, f0};
    if (!(p.ior > 0)) b.interface = Interface::opaque;  // ior 0: everything is reflected, F = 1
    if (b.eta > 1 - kMatchedIndices && b.eta < 1 + kMatchedIndices) b.alpha = 0;
  }
  if constexpr (kExtended) {
    const bool matched = b.alpha == 0 && p.roughness > 0;
    if (extensions->anisotropy > 0 && !matched) set_anisotropy(extensions->anisotropy, &b);
  }
  b.mirror = b.alpha < kMirrorAlpha;
  if (!b.mirror) b.facets = facet_row(p.roughness);
  b.root_o = facet_root<kExtended>(b, b.wo);
  set_weights<kExtended>(p, tables, transmission, &b);
}

}  // namespace tessera::render::base_bsdf
