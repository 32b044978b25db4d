#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/math/vector.h"

namespace tessera::render {

class BlobField;
class TerrainField;

/// Q(p) = p' A p + 2 b p + c, with A symmetric; inside where it is at most 0.
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

/// Faces are numbered: 0 is the curved one; 1 + 2 axis is in the lower plane of Shape::clip across
/// that axis, 2 + 2 axis in the upper one. Those from 1 on are flat: a ray that leaves one cannot
/// hit it again.
inline constexpr std::uint32_t kCurvedFace = 0;

/// An analytic surface in its object space.
struct Shape {
  enum class Form : std::uint8_t {
    quadric,  // what of the quadric's inside lies in `clip`; a box without thickness: one face
    torus,    // about the y axis
    blobs,    // where a field reaches its threshold
    terrain,  // the ground below a height field, as far as it lies in `clip`
  };
  Form form = Form::quadric;
  bool capped = true;      // the planes of `clip` bound it too; else only the curved face is there
  bool latitudes = false;  // v runs with the angle from +y, as on a globe; else with the height
  Quadric quadric;
  Box3d clip;                   // planes may be infinitely far
  double radius = 0, tube = 0;  // of a torus: of its centre line, and about that; tube < radius
  std::shared_ptr<const BlobField> blobs;
  std::shared_ptr<const TerrainField> terrain;
  Box3f bounds;  // finite

  /// The axis in which it has no thickness, or -1.
  int flat_axis() const;
  /// Whether it has an inside.
  bool closed() const {
    return (capped || form == Form::torus || form == Form::blobs) && flat_axis() < 0;
  }
};

/// Where a line passes through a surface.
struct ShapeHit {
  double t = 0;
  Vec3d point;  // object space, to double rounding on the surface
  std::uint32_t face = kCurvedFace;
  bool enters = false;  // against the outward normal
};

/// Which of a line's hits are asked for: those with t from `from` to `to`, and none after the first
/// of them on a curved face if that is enough.
struct HitsWanted {
  double from = -std::numeric_limits<double>::infinity();
  double to = std::numeric_limits<double>::infinity();
  bool first = false;
};

/// All points where the line origin + t direction passes through the shape, by rising t of either
/// sign, appended to `hits`. The direction need not be unit: t is in multiples of it. A line that
/// touches a closed shape may give two hits with the same t. None for a direction that is zero or
/// not finite. What is not wanted may be left out.
///
/// Worked out in double about the point of the line nearest to the shape, so that distance costs
/// no digits. Source: E. Haines et al., "Precision improvements for ray/sphere intersection", Ray
/// Tracing Gems, 2019, chapter 7.
void intersect_shape(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits, const HitsWanted& wanted = {});

/// The forms of intersect_shape(). `origin` is near the shape; t counts from there.
void intersect_quadric(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                       std::vector<ShapeHit>& hits);
void intersect_torus(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits);
void intersect_blobs(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits);
void intersect_terrain(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                       const HitsWanted& wanted, std::vector<ShapeHit>& hits);

}  // namespace tessera::render
