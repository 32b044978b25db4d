#pragma once

#include <cmath>

#include "worker/math/vector.h"

namespace tessera::render {

/// Right-handed orthonormal basis; n is the third axis.
struct Frame {
  Vec3f s, t, n;

  /// Orthonormal to 4e-7 for every n, including -z. Requires |n| = 1 up to float rounding.
  /// Source: Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017.
  static Frame from_normal(const Vec3f& n) {
    const float sign = std::copysign(1.0f, n.z);
    const float a = -1 / (sign + n.z);
    const float b = n.x * n.y * a;
    return {{1 + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}, n};
  }

  Vec3f to_world(const Vec3f& v) const { return s * v.x + t * v.y + n * v.z; }
  Vec3f to_local(const Vec3f& v) const { return {dot(s, v), dot(t, v), dot(n, v)}; }
};

}  // namespace tessera::render
