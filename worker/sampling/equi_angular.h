#pragma once

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Equi-angular distribution of distances along a ray: uniform in the angle at a point beside the
/// ray, so that the density follows the squared falloff of a light at that point.
/// Source: C. Kulla and M. Fajardo, "Importance sampling techniques for path tracing in
/// participating media", 2012.
class EquiAngular {
 public:
  /// Distances are in [begin, end], metres; `end` may be infinite. Requires a unit `direction`.
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

  /// False if the point is on the ray or the interval subtends no angle.
  bool usable() const { return distance_ > 0 && range_ > 0; }

  /// Samples a distance with u in [0, 1). Requires usable().
  double sample(double u) const {
    const elementary::SinCosd a = elementary::sincos(first_ + u * range_);
    const double t = nearest_ + distance_ * (a.sin / a.cos);
    return clamp(t, begin_, end_);
  }

  /// Density per metre. Requires usable().
  double pdf(double t) const {
    const double x = (t - nearest_) / distance_;
    return 1 / (range_ * distance_ * (1 + x * x));
  }

 private:
  double nearest_ = 0, distance_ = 0, first_ = 0, range_ = 0, begin_ = 0, end_ = 0;
};

}  // namespace tessera::render
