#pragma once

#include "worker/geometry/shape.h"
#include "worker/geometry/surface_point.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// Outward normal at a point of a face, object space, of any length: the gradient or, where that is
/// zero, as at an apex, the y axis. A flat shape faces the positive axis.
Vec3d shape_normal(const Shape& shape, std::uint32_t face, const Vec3d& point);

/// Texture coordinates. On the curved face, u goes once around the y axis, increasing to the right
/// as seen from outside and 0.5 at +z; v goes from 0 at the top to 1 at the bottom, by angle on an
/// ellipsoid and by height on others. On a torus v goes around the tube and is 0.5 on the outside.
/// On a terrain u and v follow x and z. On flat faces they span the side of the box; on a plane
/// they are x and z.
Vec2f shape_uv(const Shape& shape, std::uint32_t face, const Vec3f& point);

/// Direction of increasing u; w is the sign of the bitangent (+1: cross(normal, tangent)).
Vec4f shape_tangent(const Shape& shape, std::uint32_t face, const Vec3f& point);

/// World-space point of a face, with error bounds for spawning rays. Requires the unit outward
/// normal in world space. With u = 2^-24, `tolerance` bounds the rounding of the point in object
/// space, u |p|, doubled for margin and transformed to world space, and the rounding of the
/// position, u |world|; nothing else rounds to float.
SurfacePoint placed_shape_point(const Affine3d& object_to_world, const Vec3f& point,
                                const Vec3f& normal);

}  // namespace tessera::render
