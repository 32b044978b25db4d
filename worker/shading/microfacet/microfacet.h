#pragma once

#include "worker/math/vector.h"

namespace tessera::render {

/// Below this alpha a microfacet lobe is a mirror: D would exceed the precision of float.
inline constexpr float kMirrorAlpha = 1e-3f;

/// GGX (Trowbridge-Reitz) with the height-correlated Smith term in the shading frame (z along the
/// normal). T is float in the renderer, double in tables and tests.
///
/// All terms use |n x h|^2 = x^2 + y^2, which is accurate at the peak of the lobe; the (n.h)^2 form
/// of the specification is not for alpha below 1e-3.

/// Normalises v with one square root and one division, for vectors near unit length. Unlike
/// normalize() it does not handle squares that overflow or vanish.
template <typename T>
inline Vec3<T> direction_of(const Vec3<T>& v) {
  return v * (1 / std::sqrt(dot(v, v)));
}

/// Density of microfacet normals at `h`, unit, h.z > 0. Source: glTF 2.0, appendix B.3.2.
template <typename T>
inline T ggx_d(const Vec3<T>& h, T alpha) {
  const T a2 = alpha * alpha;
  const T q = alpha / (h.x * h.x + h.y * h.y + a2 * (h.z * h.z));
  return q * q * T(0.31830988618379067154);
}

/// sqrt(alpha^2 + (1 - alpha^2) c^2): c times the root in Smith's Lambda.
template <typename T>
inline T smith_root(T cos_theta, T alpha) {
  const T a2 = alpha * alpha;
  return std::sqrt(a2 + (1 - a2) * (cos_theta * cos_theta));
}

/// Anisotropic GGX: alpha `at` along x and `ab` along y. Source: KHR_materials_anisotropy.
template <typename T>
inline T ggx_d(const Vec3<T>& h, T at, T ab) {
  const T a2 = at * ab;
  const T x = ab * h.x, y = at * h.y, z = a2 * h.z;
  const T w2 = a2 / (x * x + y * y + z * z);
  return a2 * w2 * w2 * T(0.31830988618379067154);
}
template <typename T>
inline T smith_root(const Vec3<T>& w, T at, T ab) {
  const T x = at * w.x, y = ab * w.y;
  return std::sqrt(x * x + y * y + w.z * w.z);
}

/// G / (4 |n.l| |n.v|), height-correlated; positive cosines. Source: glTF 2.0, appendix B.3.2.
template <typename T>
inline T smith_visibility(T cos_o, T cos_i, T root_o, T root_i) {
  return T(0.5) / (cos_i * root_o + cos_o * root_i);
}

/// Density over solid angle of the half vectors of sample_visible_normal(), divided by wo.h: D
/// G1(wo) / cos_o.
template <typename T>
inline T visible_normal_density(T d, T cos_o, T root_o) {
  return d * 2 / (cos_o + root_o);
}

/// Samples a microfacet normal visible from `wo` (wo.z > 0), for a point (cos_phi, sin_phi) on the
/// unit circle and u in [0, 1). Source: Dupuy & Benyoub, "Sampling Visible GGX Normals with
/// Spherical Caps", 2023.
template <typename T>
inline Vec3<T> sample_visible_normal(const Vec3<T>& wo, T at, T ab, T cos_phi, T sin_phi, T u) {
  const Vec3<T> w = direction_of(Vec3<T>{wo.x * at, wo.y * ab, wo.z});
  const T hz = (1 - u) * (1 + w.z);  // positive; z of the reflected direction is hz - w.z
  const T z = hz - w.z;
  const T s2 = (1 - z) * (1 + z);
  const T s = s2 > 0 ? std::sqrt(s2) : T(0);
  return direction_of(Vec3<T>{(s * cos_phi + w.x) * at, (s * sin_phi + w.y) * ab, hz});
}
template <typename T>
inline Vec3<T> sample_visible_normal(const Vec3<T>& wo, T alpha, T cos_phi, T sin_phi, T u) {
  return sample_visible_normal(wo, alpha, alpha, cos_phi, sin_phi, u);
}

}  // namespace tessera::render
