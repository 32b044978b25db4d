#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>

#include "worker/geometry/bounds.h"
#include "worker/math/vector.h"

namespace tessera::render {

class BlobField;
class TerrainField;

/// Q(p) = p' A p + 2 b p + c, with A symmetric. The inside is Q(p) <= 0.
struct Quadric {
  Vec3d squares;   // of A: xx, yy, zz
  Vec3d products;  // of A: yz, zx, xy
  Vec3d linear;    // b
  double constant = 0;

  /// A v.
  Vec3d times(const Vec3d& v) const {
    return {squares.x * v.x + products.z * v.y + products.y * v.z,
            products.z * v.x + squares.y * v.y + products.x * v.z,
            products.y * v.x + products.x * v.y + squares.z * v.z};
  }
  double at(const Vec3d& p) const { return dot(p, times(p) + linear * 2.0) + constant; }
};

/// Face 0 is the curved one. Face 1 + 2 axis lies in the lower plane of Shape::clip perpendicular
/// to that axis, face 2 + 2 axis in the upper one. These are flat: a ray that starts on one cannot
/// hit it again.
inline constexpr std::uint32_t kCurvedFace = 0;

/// An analytic surface in its object space.
struct Shape {
  enum class Form : std::uint8_t {
    quadric,  // the quadric's inside, clipped to `clip`; one face if that has no thickness
    torus,    // around the y axis
    blobs,    // the region where a field reaches its threshold
    terrain,  // the ground below a height field, clipped to `clip`
  };
  Form form = Form::quadric;
  bool capped = true;      // whether the planes of `clip` are faces too
  bool latitudes = false;  // whether v is the angle from +y, as on a globe, instead of the height
  Quadric quadric;
  Box3d clip;                   // planes may be at infinity
  double radius = 0, tube = 0;  // torus: radii of the centre line and of the tube; tube < radius
  std::shared_ptr<const BlobField> blobs;
  std::shared_ptr<const TerrainField> terrain;
  Box3f bounds;  // all of space for a plane, otherwise finite

  /// The axis along which it has no thickness, or -1.
  int flat_axis() const {
    for (int k = 0; k < 3; ++k) {
      if (form == Form::quadric && clip.lo[k] == clip.hi[k]) return k;
    }
    return -1;
  }
  /// Whether it has finite bounds: false for a plane alone.
  bool bounded() const { return std::isfinite(bounds.hi.x); }
  /// Whether it encloses a volume.
  bool closed() const {
    return (capped || form == Form::torus || form == Form::blobs) && flat_axis() < 0;
  }
};

/// Intersection of a line with a shape's surface.
struct ShapeHit {
  double t = 0;
  Vec3d point;  // object space, on the surface up to rounding of double
  std::uint32_t face = kCurvedFace;
  bool enters = false;  // whether the line goes against the outward normal
};

/// The hits of a line that a caller needs: those with t from `from` to `to` and, with `first`, none
/// after the first of them on a curved face.
struct HitRequest {
  double from = -std::numeric_limits<double>::infinity();
  double to = std::numeric_limits<double>::infinity();
  bool first = false;
};

}  // namespace tessera::render
