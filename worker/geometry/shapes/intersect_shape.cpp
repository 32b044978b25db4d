#include "worker/geometry/shapes/intersect_shape.h"

#include <cmath>

#include "worker/geometry/shapes/blobs/blob_line.h"
#include "worker/geometry/shapes/terrain/terrain_line.h"

namespace tessera::render {

namespace {

/// The t of the point to which a line's origin is moved: that nearest to the shape's centre. A
/// plane's line keeps its origin, because a plane has no centre. A line from within the bounding
/// sphere of a terrain keeps its origin: it may start on the ground, where a rounding error of the
/// move would exceed the height of almost flat terrain.
double nearest_point(const Shape& shape, const Vec3d& origin, const Vec3d& direction) {
  if (!shape.bounded()) return 0;
  const Vec3d low(shape.bounds.lo), high(shape.bounds.hi);
  const Vec3d to_centre = (low + high) * 0.5 - origin;
  if (shape.form == Shape::Form::terrain &&
      4 * dot(to_centre, to_centre) <= dot(high - low, high - low)) {
    return 0;
  }
  return dot(to_centre, direction) / dot(direction, direction);
}

}  // namespace

void intersect_shape(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits, const HitRequest& request) {
  const double size2 = dot(direction, direction);
  if (!(size2 > 0 && std::isfinite(size2))) return;
  const double nearest = nearest_point(shape, origin, direction);
  const Vec3d near = origin + direction * nearest;
  const HitRequest moved = {request.from - nearest, request.to - nearest, request.first};
  const std::size_t first = hits.size();
  switch (shape.form) {
    case Shape::Form::quadric:
      intersect_quadric(shape, near, direction, hits);
      break;
    case Shape::Form::torus:
      intersect_torus(shape, near, direction, hits);
      break;
    case Shape::Form::blobs:
      intersect_blobs(shape, near, direction, moved, hits);
      break;
    case Shape::Form::terrain:
      intersect_terrain(shape, near, direction, moved, hits);
      break;
  }
  for (std::size_t i = first; i < hits.size(); ++i) hits[i].t += nearest;
}

}  // namespace tessera::render
