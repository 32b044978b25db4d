#pragma once

#include <array>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Triangle as seen from a point: its vertices as unit vectors, and its solid angle.
///
/// Computed in double and from edges instead of differences of unit vectors, so that small
/// triangles stay accurate. The solid angle is zero if the point lies in the triangle's plane or on
/// a vertex.
struct SphericalTriangle {
  Vec3d a, b, c;
  std::array<double, 3> distance{};  // of the corners
  double solid_angle = 0;            // steradians, [0, 2 pi]

  /// Vertices relative to the point. Source: Van Oosterom & Strackee, "The solid angle of a plane
  /// triangle", 1983.
  static SphericalTriangle seen_from_origin(const Vec3d& p, const Vec3d& q, const Vec3d& r) {
    const double lp = length(p), lq = length(q), lr = length(r);
    SphericalTriangle t;
    if (!(lp > 0) || !(lq > 0) || !(lr > 0)) return t;
    t.distance = {lp, lq, lr};
    t.a = p * (1 / lp);
    t.b = q * (1 / lq);
    t.c = r * (1 / lr);
    const double volume = std::fabs(dot(p, cross(q - p, r - p))) / (lp * lq * lr);
    const double rest = 1 + dot(t.a, t.b) + dot(t.b, t.c) + dot(t.c, t.a);
    if (volume > 0) t.solid_angle = 2 * elementary::atan2(volume, rest);
    return t;
  }

  /// Returns whether sample() is worthwhile and accurate: the triangle is neither so small that
  /// area sampling does as well, nor so large that the point nearly lies in its plane.
  bool is_near() const { return solid_angle > kMinSolidAngle && solid_angle < 6.22; }
  static constexpr double kMinSolidAngle = 3e-4;

  /// Samples a unit vector in the triangle, uniform over solid angle, for u1 and u2 in [0, 1).
  /// Requires solid_angle > 0. Source: J. Arvo, "Stratified sampling of spherical triangles", 1995.
  Vec3d sample(double u1, double u2) const {
    // The angle at a, as cosine and sine, from the planes of its two sides.
    const Vec3d ab = cross(a, b), ac = cross(a, c);
    const double sides = std::sqrt(dot(ab, ab) * dot(ac, ac));
    const double cos_a = dot(ab, ac) / sides, sin_a = std::fabs(dot(a, cross(b, c))) / sides;
    // A sub-triangle with u1 of the area and the same vertices a and b.
    const elementary::SinCosd area = elementary::sincos(u1 * solid_angle);
    const double s = area.sin * cos_a - area.cos * sin_a;
    const double t = area.cos * cos_a + area.sin * sin_a;
    const double u = t - cos_a, v = s + sin_a * dot(a, b);
    const double q = ((v * t - u * s) * cos_a - v) / ((v * s + u * t) * sin_a);
    const Vec3d corner = turned(a, c, clamp(q, -1.0, 1.0));
    // A point on the arc from b to the new corner.
    return turned(b, corner, clamp(1 - u2 * (1 - dot(corner, b)), -1.0, 1.0));
  }

  /// Barycentrics (of the second and third vertex) of the point of the plane triangle in
  /// `direction`.
  Vec2f barycentrics_at(const Vec3d& direction) const {
    // Weights of the unit vectors that sum to the direction, then of the vertices themselves.
    const double x = std::fabs(dot(direction, cross(b, c))) / distance[0];
    const double y = std::fabs(dot(direction, cross(c, a))) / distance[1];
    const double z = std::fabs(dot(direction, cross(a, b))) / distance[2];
    const double scale = 1 / (x + y + z);
    return {static_cast<float>(y * scale), static_cast<float>(z * scale)};
  }

 private:
  /// Unit vector at `cosine` from `from`, in the plane that also contains `to`.
  static Vec3d turned(const Vec3d& from, const Vec3d& to, double cosine) {
    const Vec3d across = to - from * dot(from, to);
    const double size = length(across);
    const double sine = std::sqrt((1 - cosine) * (1 + cosine));
    return size > 0 ? from * cosine + across * (sine / size) : from;
  }
};

}  // namespace tessera::render
