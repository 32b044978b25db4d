#pragma once

#include <limits>

#include "worker/math/vector.h"

namespace tessera::render {

/// Closed axis-aligned box, initially empty.
template <typename T>
struct Box {
  Vec3<T> lo = {std::numeric_limits<T>::infinity(), std::numeric_limits<T>::infinity(),
                std::numeric_limits<T>::infinity()};
  Vec3<T> hi = {-std::numeric_limits<T>::infinity(), -std::numeric_limits<T>::infinity(),
                -std::numeric_limits<T>::infinity()};

  bool operator==(const Box&) const = default;

  bool empty() const { return !(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z); }

  void extend(const Vec3<T>& p) {
    lo = min(lo, p);
    hi = max(hi, p);
  }
  void extend(const Box& b) {
    lo = min(lo, b.lo);
    hi = max(hi, b.hi);
  }

  bool contains(const Vec3<T>& p) const {
    return p.x >= lo.x && p.x <= hi.x && p.y >= lo.y && p.y <= hi.y && p.z >= lo.z && p.z <= hi.z;
  }

  /// Half the surface area in double, so that coordinates within the loader's limits do not
  /// overflow; 0 if empty.
  double half_area() const {
    if (empty()) return 0;
    const Vec3d e = Vec3d(hi) - Vec3d(lo);
    return e.x * e.y + e.y * e.z + e.z * e.x;
  }
};

using Box3f = Box<float>;
using Box3d = Box<double>;

}  // namespace tessera::render
