#pragma once

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Places along a ray by the angle under which they are seen from a point beside it: dense where
/// the ray is near to that point, as light that falls off with the squared distance wants it.
/// Source: C. Kulla and M. Fajardo, "Importance sampling techniques for path tracing in
/// participating media", 2012.
class EquiAngular {
 public:
  /// Of the ray's part [begin, end], metres; `end` may be infinite. `direction` is unit.
  EquiAngular(const Vec3d& origin, const Vec3d& direction, const Vec3d& point, double begin,
              double end) {
    const Vec3d to_point = point - origin;
    nearest_ = dot(to_point, direction);
    distance_ = length(to_point - direction * nearest_);
    first_ = elementary::atan2(begin - nearest_, distance_);
    range_ = elementary::atan2(end - nearest_, distance_) - first_;
    begin_ = begin;
    end_ = end;
  }

  /// False where the point is on the ray, or the part is seen from it under no angle.
  bool usable() const { return distance_ > 0 && range_ > 0; }

  /// For u in [0, 1). Requires usable(), as pdf().
  double sample(double u) const {
    const elementary::SinCosd a = elementary::sincos(first_ + u * range_);
    const double t = nearest_ + distance_ * (a.sin / a.cos);
    return clamp(t, begin_, end_);
  }

  /// Density a metre.
  double pdf(double t) const {
    const double x = (t - nearest_) / distance_;
    return 1 / (range_ * distance_ * (1 + x * x));
  }

 private:
  double nearest_ = 0, distance_ = 0, first_ = 0, range_ = 0, begin_ = 0, end_ = 0;
};

}  // namespace tessera::render
