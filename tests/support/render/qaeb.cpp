#include "tests/support/render/qaeb.h"

#include <algorithm>
#include <cmath>

#include "worker/geometry/clip_line.h"

namespace tessera::testing {

using render::Box3d;
using render::Hit;
using render::HitFilter;
using render::kCurvedFace;
using render::LineSegment;
using render::Ray;
using render::TerrainCells;
using render::TerrainField;
using render::Vec3d;
using render::Vec3f;

QaebTerrain::QaebTerrain(const render::Scene& scene, const Vec3d& eye, double error, double near)
    : shape_(scene.meshes.at(0).shape), eye_(eye), error_(error), near_(near) {}

double QaebTerrain::step_from(const Vec3d& p) const {
  return error_ * std::max(length(p - eye_), near_);
}

bool QaebTerrain::closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const {
  const TerrainField& field = *shape_->terrain;
  const Vec3d origin(ray.origin), direction(ray.direction);
  const Box3d bounds = {Vec3d(shape_->bounds.lo), Vec3d(shape_->bounds.hi)};
  LineSegment inside;
  if (!clip_line(bounds, origin, direction, inside)) return false;
  const double last = std::min(inside.last.t, static_cast<double>(ray.t_max));
  const double unit = 1 / length(direction);
  TerrainCells cells;
  const auto at = [&](double t) { return origin + direction * t; };
  // Sums octaves only until they decide the side.
  const auto is_below = [&](double t) {
    const Vec3d p = at(t);
    return field.clearance<0>({p.y, {}, 0}, {p.x, p.z}, {}, cells).centre < 0;
  };
  double t = std::max(inside.first.t, 0.0);
  bool below = is_below(t);
  while (t < last) {
    const double next = std::min(t + step_from(at(t)) * unit, last);
    const bool crosses = is_below(next) != below;
    if (crosses) {
      const Hit found = between(at(t), at(next), t, next);
      if (found.t < ray.t_max && (filter == nullptr || (*filter)(found))) {
        hit = found;
        return true;
      }
    }
    below = below != crosses;
    t = next;
  }
  return false;
}

Hit QaebTerrain::between(const Vec3d& p, const Vec3d& q, double from, double to) const {
  const TerrainField& field = *shape_->terrain;
  const double before = std::fabs(p.y - field.height({p.x, p.z}));
  const double after = std::fabs(q.y - field.height({q.x, q.z}));
  const double share = before > 0 ? before / (before + after) : 0;
  const Vec3d met = p + (q - p) * share;
  return {static_cast<float>(from + (to - from) * share),
          {0, 0, kCurvedFace},
          static_cast<float>(met.x),
          static_cast<float>(field.height({met.x, met.z})),
          static_cast<float>(met.z)};
}

bool QaebTerrain::any_hit(const Ray& ray, const HitFilter* filter) const {
  Hit hit;
  return closest_hit(ray, filter, hit);
}

}  // namespace tessera::testing
