#pragma once

#include <array>

#include "worker/geometry/bounds.h"
#include "worker/geometry/shapes/blobs/blob.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// An interval.
struct FieldRange {
  double low = 0, high = 0;

  /// Extends by the values from 0 to `value`.
  void add(double value) { (value < 0 ? low : high) += value; }
};

/// Bernstein coefficients of a quartic over an interval.
using BernsteinQuartic = std::array<double, 5>;

/// The sum of the fields of blobs in a box that lies within each of them. It takes the same space
/// and time for any number of blobs.
///
/// With coordinates from -1 to 1 across the box, 1 - r^2 of a blob is the scalar product of a
/// vector w with the features (1, x, y, z, x^2, y^2, z^2), and its field the quadratic form of the
/// matrix strength w w'. The matrices of all blobs are added. All |w| are at most 1, so
/// coefficients do not cancel each other's leading digits.
class BlobPolynomial {
 public:
  /// Adds a blob around the box.
  void add(const UnitBlob& blob, const Vec3d& centre, const Vec3d& half);
  /// Continues with the lower or upper half of the box along an axis.
  void take_half(int axis, bool upper);

  /// Contains all values in the box.
  FieldRange range() const;
  /// The values along the line from p to q, both in the coordinates of the box.
  BernsteinQuartic along(const Vec3d& p, const Vec3d& q) const;
  /// The gradient with respect to the coordinates of the box.
  Vec3d gradient(const Vec3d& p) const;

 private:
  using Features = std::array<double, 8>;  // the last is 0, for whole vector registers
  static double product(const Features& a, const Features& b);
  Features times(const Features& v) const;

  std::array<Features, 7> rows_{};  // symmetric
};

}  // namespace tessera::render
