#include "worker/geometry/surface_point.h"

#include <cmath>

#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

constexpr double kUnitRoundoff = 0x1p-24;

/// |M| v without translation, for v >= 0.
Vec3d absolute_transform(const Affine3d& m, const Vec3d& v) {
  return {dot(absolute(m.rows[0]), v), dot(absolute(m.rows[1]), v), dot(absolute(m.rows[2]), v)};
}

}  // namespace

Vec3f world_normal(const PlacedTriangle& triangle) {
  const Vec3d origin(triangle.v0);
  const Vec3d across = cross(Vec3d(triangle.v1) - origin, Vec3d(triangle.v2) - origin);
  const Vec3d n = transform_normal(triangle.world_to_object, across);
  const double size2 = dot(n, n);
  // Almost always: squares of products of floats and ordinary transforms fit into a double.
  if (size2 > 0x1p-900 && size2 < 0x1p900) return Vec3f(n * (1 / std::sqrt(size2)));
  return Vec3f(normalize(transform_normal(triangle.world_to_object, normalize(across))));
}

SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2) {
  return surface_point(triangle, b1, b2, world_normal(triangle));
}

SurfacePoint surface_point(const PlacedTriangle& triangle, float b1, float b2,
                           const Vec3f& normal) {
  const Vec3d origin(triangle.v0);
  const Vec3d e1 = Vec3d(triangle.v1) - origin, e2 = Vec3d(triangle.v2) - origin;
  const Vec3d p = origin + (e1 * static_cast<double>(b1) + e2 * static_cast<double>(b2));
  const Vec3d world = transform_point(triangle.object_to_world, p);
  const Vec3d extent = max(absolute(e1), absolute(e2));
  const Vec3d object_error = (absolute(p) + extent) * (2 * kUnitRoundoff);
  SurfacePoint point;
  point.position = Vec3f(world);
  point.tolerance = Vec3f(absolute_transform(triangle.object_to_world, object_error) +
                          absolute(world) * kUnitRoundoff);
  point.depth_tolerance = static_cast<float>(
      6 * kUnitRoundoff * max_abs(absolute_transform(triangle.object_to_world, extent)));
  point.normal = normal;
  return point;
}

double world_area(const PlacedTriangle& triangle) {
  const Vec3d origin(triangle.v0);
  const Vec3d e1 = transform_vector(triangle.object_to_world, Vec3d(triangle.v1) - origin);
  const Vec3d e2 = transform_vector(triangle.object_to_world, Vec3d(triangle.v2) - origin);
  return 0.5 * length(cross(e1, e2));
}

Vec3f offset_ray_origin(const SurfacePoint& point, const Vec3f& direction) {
  const Vec3f& n = point.normal;
  const float largest = max_abs(direction);
  const float along = largest > 0 ? point.depth_tolerance / largest : 0.0f;
  float distance = 0;
  for (int k = 0; k < 3; ++k) {
    distance += std::fabs(n[k]) * (point.tolerance[k] + along * std::fabs(direction[k]));
  }
  const float side = dot(direction, n) < 0 ? -distance : distance;
  Vec3f origin;
  for (int k = 0; k < 3; ++k) {
    const float shift = n[k] * side;
    const float moved = point.position[k] + shift;
    origin[k] = shift > 0 ? next_up(moved) : shift < 0 ? next_down(moved) : moved;
  }
  return origin;
}

Ray spawn_ray(const SurfacePoint& point, const TriangleId& id, const Vec3f& direction) {
  Ray ray;
  ray.origin = offset_ray_origin(point, direction);
  ray.direction = direction;
  ray.origin_triangle = id;
  return ray;
}

Ray spawn_ray_to(const SurfacePoint& from, const TriangleId& id, const SurfacePoint& to) {
  const Vec3f target = offset_ray_origin(to, from.position - to.position);
  Ray ray = spawn_ray_to(from, id, target);
  ray.t_max = 1 - 0x1p-20f;
  return ray;
}

Ray spawn_ray_to(const SurfacePoint& from, const TriangleId& id, const Vec3f& to) {
  Ray ray = spawn_ray(from, id, to - from.position);
  ray.direction = to - ray.origin;
  ray.t_max = 1;
  return ray;
}

}  // namespace tessera::render
