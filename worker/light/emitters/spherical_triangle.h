#pragma once

#include <array>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// A triangle as seen from a point: its corners as unit vectors, and the solid angle between them.
///
/// In double, from edges rather than from differences of unit vectors, so that small triangles keep
/// their digits. Zero solid angle where the point lies in the triangle's plane or on a corner.
struct SphericalTriangle {
  Vec3d a, b, c;
  std::array<double, 3> distance{};  // of the corners
  double solid_angle = 0;            // steradians, [0, 2 pi]

  /// Corners relative to the point. Source: Van Oosterom & Strackee, "The solid angle of a plane
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

  /// Whether sample() works well: neither so small that areas of triangles do as well, nor so large
  /// that the point all but lies in the plane.
  bool is_near() const { return solid_angle > kLeast && solid_angle < 6.22; }
  static constexpr double kLeast = 3e-4;

  /// A unit vector in the triangle, uniform over solid angle, for u1 and u2 in [0, 1). Requires
  /// solid_angle > 0. Source: J. Arvo, "Stratified sampling of spherical triangles", 1995.
  Vec3d sample(double u1, double u2) const {
    // The angle at a, as cosine and sine, from the planes of its two sides.
    const Vec3d ab = cross(a, b), ac = cross(a, c);
    const double sides = std::sqrt(dot(ab, ab) * dot(ac, ac));
    const double cos_a = dot(ab, ac) / sides, sin_a = std::fabs(dot(a, cross(b, c))) / sides;
    // A sub-triangle of u1 of the area, with the same corners a and b.
    const elementary::SinCosd area = elementary::sincos(u1 * solid_angle);
    const double s = area.sin * cos_a - area.cos * sin_a;
    const double t = area.cos * cos_a + area.sin * sin_a;
    const double u = t - cos_a, v = s + sin_a * dot(a, b);
    const double q = ((v * t - u * s) * cos_a - v) / ((v * s + u * t) * sin_a);
    const Vec3d corner = turned(a, c, clamp(q, -1.0, 1.0));
    // A point on the arc from b to the new corner.
    return turned(b, corner, clamp(1 - u2 * (1 - dot(corner, b)), -1.0, 1.0));
  }

  /// Barycentrics (of the second and third corner) of the point of the plane triangle that
  /// `direction` leads to.
  Vec2f place_of(const Vec3d& direction) const {
    // The weights of the unit corners that make up the direction, then of the corners themselves.
    const double x = std::fabs(dot(direction, cross(b, c))) / distance[0];
    const double y = std::fabs(dot(direction, cross(c, a))) / distance[1];
    const double z = std::fabs(dot(direction, cross(a, b))) / distance[2];
    const double scale = 1 / (x + y + z);
    return {static_cast<float>(y * scale), static_cast<float>(z * scale)};
  }

 private:
  /// The unit vector at `cosine` from `from`, in the plane that also holds `to`.
  static Vec3d turned(const Vec3d& from, const Vec3d& to, double cosine) {
    const Vec3d across = to - from * dot(from, to);
    const double size = length(across);
    const double sine = std::sqrt((1 - cosine) * (1 + cosine));
    return size > 0 ? from * cosine + across * (sine / size) : from;
  }
};

}  // namespace tessera::render
