#include "worker/geometry/shapes/shape.h"

#include <cmath>

namespace tessera::render {

int Shape::flat_axis() const {
  for (int k = 0; k < 3; ++k) {
    if (form == Form::quadric && clip.lo[k] == clip.hi[k]) return k;
  }
  return -1;
}

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
      intersect_terrain(shape, near, direction,
                        {request.from - nearest, request.to - nearest, request.first}, hits);
      break;
  }
  for (std::size_t i = first; i < hits.size(); ++i) hits[i].t += nearest;
}

}  // namespace tessera::render
