#pragma once

#include <array>

#include "worker/geometry/shapes/shape.h"
#include "worker/light/tree/light_tree.h"
#include "worker/light/emitters/spherical_strip.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// A shape that emits, as points are lit by it: directions are drawn uniformly over the solid angle
/// of a cover around it, and those that miss it give nothing. The cover is what a point sees of
/// - the rectangle around a disc or rectangle: two spherical triangles;
/// - the column around what is at least twice as long as wide: a strip (of a cylinder's side,
///   exactly);
/// - the sphere around any other shape, and around a long one seen from its end: a cone (of a
///   sphere itself, exactly); all directions where the point is inside.
/// Every visible point of the shape has the density of its cover, however near or small it is:
/// 1 - cos of the cone's angle is taken as s^2 / (1 + c), so that it keeps its digits.
/// Source: C. Wang, "Physically correct direct lighting for distribution ray tracing", Graphics
/// Gems III, 1992; M. Gamito, "Solid angle sampling of disk and cylinder lights", 2016 (the cover).
class ShapeLight {
 public:
  /// All of these must outlive it; the transforms are each other's inverse.
  ShapeLight(const Affine3d& object_to_world, const Affine3d& world_to_object,
               const Shape& shape);

  /// For the tree of lights, `radiance` being its luminance.
  LightBounds bounds(double radiance, bool both_sides) const;

  /// The solid angle of the cover as seen from a point, steradians. 0: it cannot be seen.
  double solid_angle(const Vec3d& from) const;

  /// A direction of the cover for u1, u2 in [0, 1). Requires solid_angle(from) > 0.
  Vec3d sample(const Vec3d& from, double u1, double u2) const;

  /// The first point of the shape along a direction, with t; false if it misses.
  bool find(const Vec3d& from, const Vec3d& direction, ShapeHit& hit) const;

 private:
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
  double radius_ = 0;               // of the sphere around it; 0 for flat shapes
  Column column_;                   // around it, about the same centre; of radius 0 if not long
  Vec3d corner_, edge_u_, edge_v_;  // of the rectangle around a flat shape
};

}  // namespace tessera::render
