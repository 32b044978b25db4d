#pragma once

#include <array>
#include <optional>
#include <span>

#include "worker/geometry/shape.h"
#include "worker/light/emitters/spherical_strip.h"
#include "worker/light/tree/light_tree.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// A shape as an area light. Directions are sampled uniformly over the solid angle of a bounding
/// proxy; those that miss the shape give no light. The proxy is
/// - for a disc or rectangle: its rectangle, as two spherical triangles;
/// - for a shape at least twice as long as wide: its bounding cylinder, as a spherical strip (exact
/// for the side of a cylinder);
/// - for any other shape, and for a long one seen from its end: its bounding sphere, as a cone
/// (exact for a sphere), or all directions if the point is inside.
/// Every visible point of the shape has the density of its proxy, at any distance and size: 1 - cos
/// of the cone's angle is computed as s^2 / (1 + c), which avoids cancellation.
///
/// Source: C. Wang, "Physically correct direct lighting for distribution ray tracing", Graphics
/// Gems III, 1992; M. Gamito, "Solid angle sampling of disk and cylinder lights", 2016 (the
/// proxies).
class ShapeLight {
 public:
  /// All arguments must outlive it; the transforms are inverses of each other.
  ShapeLight(const Affine3d& object_to_world, const Affine3d& world_to_object, const Shape& shape);

  /// Bounds for the light tree; `radiance` is its luminance.
  LightBounds bounds(double radiance, bool both_sides) const;

  /// Solid angle of the bounding proxy seen from a point, steradians. 0: invisible.
  double solid_angle(const Vec3d& from) const;

  /// Samples a direction towards the proxy for u1, u2 in [0, 1). Requires solid_angle(from) > 0.
  Vec3d sample(const Vec3d& from, double u1, double u2) const;

  /// Finds the first point of the shape along a direction, with its t; false if it misses.
  bool find(const Vec3d& from, const Vec3d& direction, ShapeHit& hit) const;

  /// Distances between which a ray may be inside the shape, which must be closed.
  struct Chord {
    double begin = 0, end = 0;
  };
  /// nullopt if the ray misses it.
  std::optional<Chord> chord(const Vec3d& from, const Vec3d& direction) const;

 private:
  std::span<const ShapeHit> hits_along(const Vec3d& from, const Vec3d& direction) const;
  void enclose_flat(int flat_axis);
  void enclose_long(const std::array<Vec3d, 3>& half);
  Box3d world_box() const;
  SphericalStrip strip(const Vec3d& from) const {
    return column_.radius > 0 ? SphericalStrip(column_, centre_ - from) : SphericalStrip();
  }

  const Affine3d& object_to_world_;
  const Affine3d& world_to_object_;
  const Shape& shape_;
  Vec3d centre_;
  double radius_ = 0;  // of the bounding sphere; 0 for flat shapes
  Column column_;      // bounding cylinder around the same centre; radius 0 if not long
  Vec3d corner_, edge_u_, edge_v_;  // of the rectangle around a flat shape
};

}  // namespace tessera::render
