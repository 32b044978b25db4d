#include "worker/accel/solids/csg_line.h"

#include <algorithm>
#include <cmath>

#include "worker/geometry/object_ray.h"

namespace tessera::render {
namespace {

/// A point relative to the ray, projected along it.
struct Projected {
  float x, y;
};

Projected project(const ObjectRay& ray, const Vec3f& v) {
  const Vec3f a = v - ray.origin;
  return {a[ray.kx] - ray.sx * a[ray.kz], a[ray.ky] - ray.sy * a[ray.kz]};
}

/// Returns the side of the edge from p to q on which the ray passes: 1 left, -1 right. Treats a ray
/// on the edge as if it were moved by an epsilon towards -x and a much smaller one towards -y.
int side(const Projected& p, const Projected& q) {
  const float area = difference_of_products(p.x, q.y, p.y, q.x);
  if (area != 0) return area > 0 ? 1 : -1;
  if (p.y != q.y) return q.y > p.y ? 1 : -1;
  return q.x < p.x ? 1 : -1;
}

/// Returns 1 if the ray crosses the triangle against its normal, -1 along it, 0 if it misses. Uses
/// the edge functions of intersect_triangle().
std::int32_t crossing(const ObjectRay& ray, const Vec3f& v0, const Vec3f& v1, const Vec3f& v2) {
  const Projected a = project(ray, v0), b = project(ray, v1), c = project(ray, v2);
  const int u = side(c, b), v = side(a, c), w = side(b, a);
  if (u != v || v != w) return 0;
  // Left of all edges: the corners are clockwise as seen against kz, so the normal points to -kz.
  const bool against_kz = u > 0;
  return against_kz == (ray.backwards[ray.kz] == 0) ? 1 : -1;
}

}  // namespace

void CsgLine::start(std::uint32_t operand_count) {
  crossings_.clear();
  winding_.assign(operand_count, 0);
}

void CsgLine::add_shape(std::uint32_t operand, const Hit& hit, bool enters, bool behind) {
  const std::int32_t change = enters ? 1 : -1;
  if (behind) {
    winding_[operand] += change;
  } else {
    crossings_.push_back({hit, operand, change});
  }
}

void CsgLine::add_mesh(std::uint32_t operand, const Operand& mesh, const Ray& ray,
                       std::span<Hit> hits) {
  Vec3f origin = ray.origin, direction = ray.direction;
  if (!is_identity(mesh.world_to_object)) {
    transform_ray(mesh.world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ObjectRay object_ray;
  if (!make_object_ray(origin, direction, {{0, 0, 0}, {0, 0, 0}}, object_ray)) return;
  std::sort(hits.begin(), hits.end(), [](const Hit& a, const Hit& b) { return a.id < b.id; });
  TriangleId last;
  for (const Hit& hit : hits) {
    if (hit.id == last) continue;  // a triangle in several leaves
    last = hit.id;
    const Primitive& primitive = mesh.primitives[hit.id.primitive];
    const auto& [i0, i1, i2] = primitive.triangles[hit.id.triangle];
    const std::int32_t change = crossing(object_ray, primitive.positions[i0],
                                         primitive.positions[i1], primitive.positions[i2]);
    if (change == 0) continue;
    crossings_.push_back({hit, operand, change});
    winding_[operand] -= change;  // at the origin, since it is 0 at infinity
  }
}

bool CsgLine::inside(std::span<const CsgStep> steps) {
  stack_.clear();
  for (const CsgStep& step : steps) {
    if (step.is_operand) {
      stack_.push_back(winding_[step.number] != 0 ? 1 : 0);
      continue;
    }
    const auto first = stack_.end() - static_cast<std::ptrdiff_t>(step.number);
    const auto count = std::count(first, stack_.end(), std::uint8_t{1});
    bool result = false;
    switch (step.operation) {
      case CsgOperation::unite:
        result = count > 0;
        break;
      case CsgOperation::intersect:
        result = count == static_cast<std::ptrdiff_t>(step.number);
        break;
      case CsgOperation::subtract:
        result = *first == 1 && count == 1;
        break;
      case CsgOperation::exclude:
        result = count % 2 == 1;
        break;
    }
    stack_.erase(first, stack_.end());
    stack_.push_back(result ? 1 : 0);
  }
  return stack_[0] != 0;
}

void CsgLine::finish(std::span<const CsgStep> steps, std::vector<Hit>& hits) {
  std::sort(crossings_.begin(), crossings_.end(),
            [](const Crossing& a, const Crossing& b) { return precedes(a.hit, b.hit); });
  bool was_inside = inside(steps);
  for (std::size_t i = 0; i < crossings_.size();) {
    previous_winding_ = winding_;
    const std::size_t first = i;
    const float t = crossings_[i].hit.t;
    for (; i < crossings_.size() && crossings_[i].hit.t == t; ++i) {
      winding_[crossings_[i].operand] += crossings_[i].winding_change;
    }
    const bool is_inside = inside(steps);
    if (is_inside == was_inside) continue;
    was_inside = is_inside;
    if (!std::isfinite(t)) continue;
    const auto visible =
        std::find_if(crossings_.begin() + static_cast<std::ptrdiff_t>(first), crossings_.end(),
                     [&](const Crossing& c) {
                       return (previous_winding_[c.operand] != 0) != (winding_[c.operand] != 0);
                     });
    Hit hit = visible->hit;
    if ((visible->winding_change > 0) != is_inside) hit.id.triangle |= kFlippedSide;
    hits.push_back(hit);
  }
}

}  // namespace tessera::render
