#pragma once

#include <array>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Rectangle as seen from a point: its position in a local frame and its solid angle, in double.
/// The solid angle is zero if the point lies in the rectangle's plane.
///
/// Source: C. Ureña, M. Fajardo, A. King, "An area-preserving parametrization for spherical
/// rectangles", EGSR 2013. Unlike there, the solid angle is a sum of four arc tangents, which is
/// accurate for small ones, and angles are added as products of complex numbers.
class SphericalRectangle {
 public:
  SphericalRectangle() = default;
  /// The rectangle corner + s along_s + t along_t, s and t in [0, 1], with the corner relative to
  /// the point. The sides are perpendicular and not zero.
  SphericalRectangle(const Vec3d& corner, const Vec3d& along_s, const Vec3d& along_t) {
    const double width = length(along_s), height = length(along_t);
    const Vec3d x = along_s * (1 / width), y = along_t * (1 / height);
    x0_ = dot(corner, x);
    y0_ = dot(corner, y);
    z_ = std::fabs(dot(corner, cross(x, y)));
    x1_ = x0_ + width;
    y1_ = y0_ + height;
    if (!(z_ > 0)) return;
    // The rectangle from (0, 0) to (x, y) has the argument of z |(x, y, z)| + i x y.
    r00_ = distance(x0_, y0_);
    r01_ = distance(x0_, y1_);
    const Complex low = Complex{z_ * r00_, x0_ * y0_} * Complex{z_ * r01_, -x0_ * y1_};
    const Complex high =
        Complex{z_ * distance(x1_, y1_), x1_ * y1_} * Complex{z_ * distance(x1_, y0_), -x1_ * y0_};
    const Complex sum = low * high;
    solid_angle_ = elementary::atan2(sum.imaginary, sum.real);
    if (solid_angle_ < 0) solid_angle_ += 2 * kPi;
  }

  double solid_angle() const { return solid_angle_; }  // steradians, [0, 2 pi]

  /// Returns whether sample() is accurate; see SphericalTriangle::is_near().
  bool is_near() const { return solid_angle_ > 3e-4 && solid_angle_ < 6.22; }

  /// Coordinates s and t of a point, uniform over solid angle, for u1 and u2 in [0, 1). Requires
  /// is_near().
  std::array<double, 2> sample(double u1, double u2) const {
    const double at_x0 = std::sqrt(z_ * z_ + x0_ * x0_);
    const double at_y0 = std::sqrt(z_ * z_ + y0_ * y0_), at_y1 = std::sqrt(z_ * z_ + y1_ * y1_);
    // The angles at (x0, y1) and (x0, y0), and their sum.
    const Complex far_end = Complex{y1_ * x0_, z_ * r01_} * (1 / (at_y1 * at_x0));
    const Complex near_end = Complex{-x0_ * y0_, z_ * r00_} * (1 / (at_x0 * at_y0));
    const Complex ends = far_end * near_end;
    // The line of constant x that has u1 of the solid angle on its left.
    const elementary::SinCosd part = elementary::sincos(u1 * solid_angle_);
    const Complex turn = Complex{part.cos, part.sin} * Complex{ends.real, -ends.imaginary};
    const double b0 = -y0_ / at_y0, b1 = y1_ / at_y1;
    const double slope = (turn.real * b0 - b1) / turn.imaginary;
    const double c = std::copysign(1 / std::sqrt(slope * slope + b0 * b0), slope);
    const double x = clamp(c * z_ / std::sqrt(clamp(1 - c * c, 1e-300, 1.0)), x0_, x1_);
    // The point on that line below which u2 of its arc lies.
    const double d2 = z_ * z_ + x * x;
    const double h0 = y0_ / std::sqrt(d2 + y0_ * y0_), h1 = y1_ / std::sqrt(d2 + y1_ * y1_);
    const double h = h0 + u2 * (h1 - h0), rest = 1 - h * h;
    const double y = rest > 1e-15 ? h * std::sqrt(d2 / rest) : y1_;
    return {(x - x0_) / (x1_ - x0_), clamp((y - y0_) / (y1_ - y0_), 0.0, 1.0)};
  }

 private:
  static constexpr double kPi = 3.14159265358979323846;

  struct Complex {
    double real, imaginary;
    Complex operator*(const Complex& b) const {
      return {real * b.real - imaginary * b.imaginary, real * b.imaginary + imaginary * b.real};
    }
    Complex operator*(double b) const { return {real * b, imaginary * b}; }
  };

  double distance(double x, double y) const { return std::sqrt(x * x + y * y + z_ * z_); }

  double x0_ = 0, y0_ = 0, x1_ = 0, y1_ = 0, z_ = 0;
  double r00_ = 0, r01_ = 0;  // of the corners at x0
  double solid_angle_ = 0;
};

}  // namespace tessera::render
