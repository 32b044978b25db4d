#pragma once

#include "worker/shading/bsdf/base_facets.h"

/// Coupling of the diffuse lobe with the dielectric layer over it. Used by base_bsdf.h and
/// base_prepare.h only.
///
/// The layer's facets have the directional albedo E, with Fresnel's term, and leave 1 - E of the
/// light. A lobe rho / pi (1 - E(wo)) (1 - E(wi)) / (1 - mean of E) spreads exactly that: for rho =
/// 1, facets and lobe together scatter all light, from every direction, and the BSDF is reciprocal.
/// Source: C. Kulla, A. Conty, "Revisiting Physically Based Shading at Imageworks", 2017, section
/// 2.3. The weight 1 - F at the half vector of each pair of directions, as in the specification's
/// sample code, gives up to 1.93 times the light at grazing angles.
///
/// Tables of E are rounded up and its means down, so that errors lose energy.
namespace tessera::render::base_bsdf {

/// E as a function of the layer's f0 and weight: f0 a + weight b + total.
struct CoverAlbedo {
  float a = 0, b = 0, total = 0;
};

/// The part of E that a smooth layer has, from its Fresnel term s in 0..1 relative to f0.
inline CoverAlbedo smooth_cover(float s) {
  return {1 - s, s, 0};
}

/// Index of refraction of the side other than that of `w`, relative to it, if the layer has an
/// exact Fresnel term; 0 for Schlick's.
template <bool kExtended>
inline float exact_eta(const Bsdf& b, bool same_side) {
  if (b.interface == Interface::solid) return same_side ? b.eta : 1 / b.eta;
  if constexpr (kExtended) {
    if (!(b.extended->film.weight > 0)) return b.extended->exact_ior;
  }
  return 0;
}

/// E of a smooth layer at cosine `c`.
inline CoverAlbedo smooth_cover_at(float c, float eta) {
  if (!(eta > 0)) return smooth_cover(schlick_weight(c));
  const float exact = fresnel_dielectric(c, eta);
  if (exact >= 1) return {0, 0, 1};
  const float normal = f0_from_ior(eta);
  return smooth_cover((exact - normal) / (1 - normal));
}

/// The cosine-weighted mean of smooth_cover_at().
inline CoverAlbedo mean_smooth_cover(float eta) {
  if (!(eta > 0)) return smooth_cover(1.0f / 21);
  const float normal = f0_from_ior(eta), passed = mean_transmittance_from_dense(eta);
  if (eta >= 1) return smooth_cover((1 - passed * (eta * eta) - normal) / (1 - normal));
  const float within = eta * eta;  // the share of the light inside the critical cone
  const float s = (within - passed - normal * within) / (1 - normal);
  return {within - s, s, 1 - within};
}

inline CoverAlbedo cover_of(const ReflectedAlbedo& e) {
  return {e.a, e.b, e.total};
}

/// Returns whether a side of a solid is the denser one.
inline bool is_dense(const Bsdf& b, bool same_side) {
  return b.interface == Interface::solid && (b.eta < 1) == same_side;
}

/// E of the anisotropic facets of a solid from its denser side, for which there is no table: the
/// larger of those of isotropic facets with either alpha.
inline CoverAlbedo anisotropic_dense_cover(const Bsdf& b, float c) {
  const ExtendedLobes& x = *b.extended;
  if (x.dense_t.nodes == nullptr) return {0, 0, 1};
  const ReflectedAlbedo p = GlassTable::reflected(b.eta < 1 ? b.glass : x.far_glass, c);
  const ReflectedAlbedo q = GlassTable::reflected(x.dense_t, c);
  return {p.a > q.a ? p.a : q.a, p.b > q.b ? p.b : q.b, p.total > q.total ? p.total : q.total};
}

/// E for light along `w`, on the viewer's side or on the other.
template <bool kExtended>
inline CoverAlbedo cover_at(const Bsdf& b, const Vec3f& w) {
  const bool same_side = w.z > 0;
  const float c = std::fabs(w.z);
  if (!b.mirror) {
    if constexpr (kExtended) {
      const ExtendedLobes& x = *b.extended;
      if (x.alpha_t > 0) {
        if (is_dense(b, same_side)) return anisotropic_dense_cover(b, c);
        const FacetAlbedo e = facet_albedo<true>(b, w);
        return {e.a, e.b, 0};
      }
      if (!same_side && x.far_glass.nodes != nullptr) {
        return cover_of(GlassTable::reflected(x.far_glass, c));
      }
    }
    if (same_side && b.glass.nodes != nullptr) [[unlikely]] {
      return cover_of(GlassTable::reflected(b.glass, c));
    }
    if (b.interface != Interface::solid) {
      const FacetAlbedo e = facet_albedo<kExtended>(b, w);
      return {e.a, e.b, 0};
    }
  }
  return smooth_cover_at(c, exact_eta<kExtended>(b, same_side));
}

/// The mean of cover_at() on one side, or less. `table` is that of a rough layer with exact Fresnel
/// term.
template <bool kExtended>
inline CoverAlbedo mean_cover(const Bsdf& b, const GlassTable* table, bool same_side) {
  if (!b.mirror) {
    bool use_facets = table == nullptr && b.interface != Interface::solid;
    if constexpr (kExtended) {
      if (b.extended->alpha_t > 0) use_facets = !is_dense(b, same_side);
    }
    if (use_facets) {
      const FacetAlbedo e = mean_facet_albedo<kExtended>(b);
      return {e.a, e.b, 0};
    }
    if (table != nullptr) return cover_of(table->mean_reflected(b.roughness));
  }
  return mean_smooth_cover(exact_eta<kExtended>(b, same_side));
}

/// The share 1 - E that the layer leaves.
inline Vec3f passed(const Bsdf& b, const CoverAlbedo& e) {
  const float rest = 1 - (b.specular_weight * e.b + e.total);
  if (b.channelwise) [[unlikely]]
    return max(Vec3f{rest, rest, rest} - b.cover_f0 * e.a, Vec3f{});
  const float left = rest - b.cover_f0.x * e.a;
  const float share = left > 0 ? left : 0;
  return {share, share, share};
}

/// Factor of the diffuse lobe for light along `wi`: (1 - E(wi)) / pi.
template <bool kExtended>
inline Vec3f passed_to_base(const Bsdf& b, const Vec3f& wi) {
  return passed(b, cover_at<kExtended>(b, wi)) * kInvPi;
}

/// (1 - E(wo)) / (1 - mean of E), of the mean on one side, for a diffuse lobe there.
template <bool kExtended>
inline Vec3f coupling_factor(const Bsdf& b, const Vec3f& passed_o, const GlassTable* table,
                             bool same_side) {
  const CoverAlbedo mean = mean_cover<kExtended>(b, table, same_side);
  Vec3f left = passed(b, mean);
  if constexpr (kExtended) {
    // A rough diffuse lobe may send more light than Lambert's to where the layer reflects less.
    constexpr float kMaxShift = 0.25f;
    if (same_side && b.extended->rough.roughness > 0) {
      left += (Vec3f{1, 1, 1} - left) * (kMaxShift * b.extended->rough.roughness);
    }
  }
  const auto share = [&](float o, float all) { return all > 0 ? o / all : 0; };
  if (b.channelwise) [[unlikely]] {
    return {share(passed_o.x, left.x), share(passed_o.y, left.y), share(passed_o.z, left.z)};
  }
  const float factor = share(passed_o.x, left.x);
  return {factor, factor, factor};
}

}  // namespace tessera::render::base_bsdf
