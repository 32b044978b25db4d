#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "worker/geometry/bounds.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// An ellipsoid with the field strength (1 - r^2)^2 inside, where r is 0 at its centre and 1 at its
/// surface, and 0 outside. The gradient is continuous, and along a line the field is a quartic.
/// Source of the kernel: S. Murakami, H. Ichihara, "On a 3D display method by metaball technique",
/// Transactions of the IEICE J70-D(8), 1987.
struct Blob {
  Vec3d centre;
  Vec3d radii;  // above 0
  double strength = 1;

  /// Box around the ellipsoid with its radii multiplied by `scale`, padded for rounding.
  Box3d box(double scale) const {
    const Vec3d half = radii * (scale * (1 + 0x1p-40));
    return {centre - half, centre + half};
  }
  /// Box around the points with (1 - r^2)^2 >= `value`; empty if there are none. Requires a
  /// positive value.
  Box3d box_above(double value) const {
    const double least = std::sqrt(value);
    return least < 1 ? box(std::sqrt(1 - least)) : Box3d{};
  }
  /// The negated gradient of the field; 0 outside.
  Vec3d outward_gradient(const Vec3d& point) const {
    const Vec3d p = (point - centre) / radii;
    const double left = 1 - dot(p, p);
    return left > 0 ? p / radii * (4 * strength * left) : Vec3d{};
  }
};

/// Two bytes, since cells hold many.
using BlobIndex = std::uint16_t;

/// A blob with the inverse of its radii. All zeros is a blob without a field.
struct alignas(64) UnitBlob {  // a cache line
  Vec3d centre, scale;         // scale: 1 / radii
  double strength = 0;
  double unused = 0;
};

}  // namespace tessera::render
