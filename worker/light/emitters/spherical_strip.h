#pragma once

#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// A cylinder: all points within `radius` of its axis and `half_length` of its centre along it.
struct Column {
  Vec3d axis;  // unit
  double radius = 0, half_length = 0;
};

/// Directions in which a point beside a cylinder may see it: between the two planes through the
/// point that touch the cylinder, from its lowest point to its highest along the axis. It is exact
/// except at the ends of the cylinder, where it is slightly larger.
///
/// Its solid angle is the angle about the axis times the difference of the sines of elevation
/// (Archimedes), so both can be sampled uniformly. After the idea, with a rectangle, of M. Gamito,
/// "Solid angle sampling of disk and cylinder lights", EGSR 2016.
class SphericalStrip {
 public:
  SphericalStrip() = default;

  /// `to_centre`: from the point to the centre of the cylinder.
  SphericalStrip(const Column& column, const Vec3d& to_centre) : axis_(column.axis) {
    const double along = dot(to_centre, column.axis);
    const Vec3d across = to_centre - column.axis * along;
    const double distance = length(across);
    if (!(distance > column.radius)) return;
    towards_ = across / distance;
    const double near = distance - column.radius, far = distance + column.radius;
    const double low = along - column.half_length, high = along + column.half_length;
    low_ = sine(low, low < 0 ? near : far);
    high_ = sine(high, high > 0 ? near : far);
    half_angle_ = elementary::atan2(column.radius, std::sqrt(near * far));
  }

  /// Returns whether the point is outside the infinite cylinder and close enough that the sines
  /// keep more than half of their digits.
  bool usable() const { return high_ - low_ > 0x1p-26; }

  double solid_angle() const { return 2 * half_angle_ * (high_ - low_); }  // steradians

  /// Samples a unit vector uniformly over solid angle, for u1 and u2 in [0, 1). Requires usable().
  Vec3d sample(double u1, double u2) const {
    const elementary::SinCosd turn = elementary::sincos((2 * u1 - 1) * half_angle_);
    const double height = low_ + u2 * (high_ - low_);
    const Vec3d level = towards_ * turn.cos + cross(axis_, towards_) * turn.sin;
    return axis_ * height + level * std::sqrt((1 - height) * (1 + height));
  }

 private:
  /// Sine of the elevation of a point `up` along the axis and `away` from it.
  static double sine(double up, double away) { return up / std::sqrt(up * up + away * away); }

  Vec3d axis_, towards_;   // unit, perpendicular
  double half_angle_ = 0;  // radians about the axis, to both sides
  double low_ = 0, high_ = 0;
};

}  // namespace tessera::render
