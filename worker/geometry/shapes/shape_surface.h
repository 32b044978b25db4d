#pragma once

#include "worker/geometry/shapes/shape.h"
#include "worker/geometry/surface_point.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// The outward normal at a point of a face, object space: the gradient, of any length. At an apex
/// or a saddle, where there is none, along the axis. A flat shape faces its axis.
Vec3d shape_normal(const Shape& shape, std::uint32_t face, const Vec3d& point);

/// Texture coordinates. The curved face: u once around the y axis, rising to the right as seen from
/// outside, 0.5 at +z; v from 0 at the top to 1 at the bottom, with the angle on an ellipsoid, with
/// the height on others; on a torus v goes round the tube, 0.5 outside. On a terrain u and v run
/// along x and z. Flat faces: from corner to
/// corner of their side of the box.
Vec2f shape_uv(const Shape& shape, std::uint32_t face, const Vec3f& point);

/// The direction in which u rises, and in w the side of the bitangent (+1: cross(normal, tangent)).
Vec4f shape_tangent(const Shape& shape, std::uint32_t face, const Vec3f& point);

/// A point of a face as an instance places it, with what rays that start there need. `normal` is
/// the unit outward one in the world. With u = 2^-24, `tolerance` bounds the rounding of the point
/// in object space, u |p|, doubled for margin and taken to world space, and that of the position,
/// u |world|; nothing else rounds to float.
SurfacePoint placed_shape_point(const Affine3d& object_to_world, const Vec3f& point,
                                const Vec3f& normal);

}  // namespace tessera::render
