#pragma once

#include <array>
#include <optional>

#include "worker/math/vector.h"

namespace tessera::render {

/// Affine map p -> M p + t of column vectors: the rows of M, then t.
template <typename T>
struct Affine {
  std::array<Vec3<T>, 3> rows = {Vec3<T>{1, 0, 0}, Vec3<T>{0, 1, 0}, Vec3<T>{0, 0, 1}};
  Vec3<T> translation;

  bool operator==(const Affine&) const = default;

  template <typename U>
  explicit operator Affine<U>() const {
    return {{Vec3<U>(rows[0]), Vec3<U>(rows[1]), Vec3<U>(rows[2])}, Vec3<U>(translation)};
  }
};

using Affine3d = Affine<double>;
using Affine3f = Affine<float>;

template <typename T>
inline Vec3<T> transform_vector(const Affine<T>& m, const Vec3<T>& v) {
  return {dot(m.rows[0], v), dot(m.rows[1], v), dot(m.rows[2], v)};
}

template <typename T>
inline Vec3<T> transform_point(const Affine<T>& m, const Vec3<T>& p) {
  return transform_vector(m, p) + m.translation;
}

/// M^T n. Transforms normals from object to world space when `inverse` is the world-to-object
/// transform; the result is not normalised.
template <typename T>
inline Vec3<T> transform_normal(const Affine<T>& inverse, const Vec3<T>& n) {
  return inverse.rows[0] * n.x + inverse.rows[1] * n.y + inverse.rows[2] * n.z;
}

/// The map that applies b, then a.
template <typename T>
inline Affine<T> operator*(const Affine<T>& a, const Affine<T>& b) {
  Affine<T> c;
  for (int i = 0; i < 3; ++i) {
    c.rows[i] = b.rows[0] * a.rows[i].x + b.rows[1] * a.rows[i].y + b.rows[2] * a.rows[i].z;
  }
  c.translation = transform_point(a, b.translation);
  return c;
}

/// Whether m maps every point to itself.
template <typename T>
inline bool is_identity(const Affine<T>& m) {
  return m == Affine<T>{};
}

/// Determinant of the 3x3 part.
template <typename T>
inline T determinant(const Affine<T>& m) {
  return dot(m.rows[0], cross(m.rows[1], m.rows[2]));
}

/// Inverse; nullopt when the matrix is singular or not finite.
inline std::optional<Affine3d> inverse(const Affine3d& m) {
  const Vec3d c0 = cross(m.rows[1], m.rows[2]);
  const Vec3d c1 = cross(m.rows[2], m.rows[0]);
  const Vec3d c2 = cross(m.rows[0], m.rows[1]);
  const double det = dot(m.rows[0], c0);
  const double inv = 1 / det;
  if (det == 0 || !std::isfinite(inv)) return std::nullopt;
  Affine3d r;
  r.rows = {Vec3d{c0.x, c1.x, c2.x} * inv, Vec3d{c0.y, c1.y, c2.y} * inv,
            Vec3d{c0.z, c1.z, c2.z} * inv};
  r.translation = -transform_vector(r, m.translation);
  if (!std::isfinite(max_abs(r.rows[0]) + max_abs(r.rows[1]) + max_abs(r.rows[2]) +
                     max_abs(r.translation))) {
    return std::nullopt;
  }
  return r;
}

}  // namespace tessera::render
