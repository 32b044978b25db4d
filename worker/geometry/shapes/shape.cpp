#include "worker/geometry/shapes/shape.h"

#include <cmath>

namespace tessera::render {

int Shape::flat_axis() const {
  for (int k = 0; k < 3; ++k) {
    if (form == Form::quadric && clip.lo[k] == clip.hi[k]) return k;
  }
  return -1;
}

namespace {

/// Intersects with a terrain. A line from within its bounding sphere keeps its origin: it may start
/// on the ground, where a rounding error of the shift would exceed the height of almost flat
/// terrain.
void intersect_terrain_near(const Shape& shape, const Vec3d& origin, double nearest,
                            const Vec3d& direction, const HitRequest& request,
                            std::vector<ShapeHit>& hits) {
  const Vec3d size = Vec3d(shape.bounds.hi) - Vec3d(shape.bounds.lo);
  const Vec3d from_centre = origin - (Vec3d(shape.bounds.lo) + size * 0.5);
  if (4 * dot(from_centre, from_centre) <= dot(size, size)) {
    return intersect_terrain(shape, origin, direction, request, hits);
  }
  const std::size_t first = hits.size();
  intersect_terrain(shape, origin + direction * nearest, direction,
                    {request.from - nearest, request.to - nearest, request.first}, hits);
  for (std::size_t i = first; i < hits.size(); ++i) hits[i].t += nearest;
}

}  // namespace

void intersect_shape(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits, const HitRequest& request) {
  const double size2 = dot(direction, direction);
  if (!(size2 > 0 && std::isfinite(size2))) return;
  const Vec3d centre = (Vec3d(shape.bounds.lo) + Vec3d(shape.bounds.hi)) * 0.5;
  const double nearest = dot(centre - origin, direction) / size2;
  const Vec3d near = origin + direction * nearest;
  const std::size_t first = hits.size();
  switch (shape.form) {
    case Shape::Form::quadric:
      intersect_quadric(shape, near, direction, hits);
      break;
    case Shape::Form::torus:
      intersect_torus(shape, near, direction, hits);
      break;
    case Shape::Form::blobs:
      intersect_blobs(shape, near, direction, hits);
      break;
    case Shape::Form::terrain:
      return intersect_terrain_near(shape, origin, nearest, direction, request, hits);
  }
  for (std::size_t i = first; i < hits.size(); ++i) hits[i].t += nearest;
}

}  // namespace tessera::render
