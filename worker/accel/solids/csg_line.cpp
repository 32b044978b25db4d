#include "worker/accel/solids/csg_line.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "worker/geometry/object_ray.h"
#include "worker/math/float_bits.h"

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
  origin_face_.reset();
  winding_.assign(operand_count, 0);
}

void CsgLine::add_shape(std::uint32_t operand, const Hit& hit, const CrossingBounds& bounds,
                        bool enters, bool behind) {
  const std::int32_t change = enters ? 1 : -1;
  if (behind) {
    winding_[operand] += change;
  } else {
    crossings_.push_back({bounds, hit, operand, change});
  }
}

void CsgLine::add_mesh(std::uint32_t operand, const Operand& mesh, const OperandLine& line,
                       const Ray& ray, std::span<Hit> hits) {
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
    const auto [v0, v1, v2] = triangle_of(mesh, hit.id);
    const std::int32_t change = crossing(object_ray, v0, v1, v2);
    if (change == 0) continue;
    const CrossingBounds bounds = triangle_crossing(line, Vec3d(v0), Vec3d(v1), Vec3d(v2));
    crossings_.push_back({bounds, hit, operand, change});
    // A hit ahead of the origin by the float test is ahead, whatever the sign of the precise t.
    crossings_.back().hit.t = bounds.t > 0 ? static_cast<float>(bounds.t) : 0;
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

void CsgLine::pass_origin_face() {
  if (!origin_face_) return;
  std::erase_if(crossings_, [&](const Crossing& c) {
    if (c.operand == origin_operand_) return false;
    const double distance = std::fabs(c.bounds.t - origin_face_->t);
    if (!(distance <= c.bounds.error + origin_face_->error)) return false;
    winding_[c.operand] += c.winding_change;
    return true;
  });
}

std::size_t CsgLine::end_of_group(std::size_t first) {
  double reach = -std::numeric_limits<double>::infinity();
  std::size_t i = first;
  for (; i < crossings_.size(); ++i) {
    const Crossing& next = crossings_[i];
    // The faces of one operand are as distinct as they are stored: both sides of a thin wall
    // remain.
    const std::size_t own = latest_[next.operand];
    const bool has_own = own >= first && own < i;
    const CrossingBounds& other = crossings_[has_own ? own : first].bounds;
    const bool coincides = has_own
                               ? next.bounds.t - other.t <= next.bounds.rounding + other.rounding
                               : next.bounds.t - next.bounds.error <= reach;
    if (i > first && !coincides) break;
    latest_[next.operand] = i;
    reach = std::max(reach, next.bounds.t + next.bounds.error);
  }
  return i;
}

void CsgLine::finish(std::span<const CsgStep> steps, std::vector<Hit>& hits) {
  pass_origin_face();
  std::sort(crossings_.begin(), crossings_.end(), [](const Crossing& a, const Crossing& b) {
    return a.bounds.t < b.bounds.t || (a.bounds.t == b.bounds.t && a.hit.id < b.hit.id);
  });
  latest_.assign(winding_.size(), crossings_.size());
  bool was_inside = inside(steps);
  float last_t = -1;
  for (std::size_t first = 0, end = 0; first < crossings_.size(); first = end) {
    end = end_of_group(first);
    const std::span<const Crossing> group(crossings_.data() + first, end - first);
    previous_winding_ = winding_;
    for (const Crossing& c : group) winding_[c.operand] += c.winding_change;
    const bool is_inside = inside(steps);
    if (is_inside == was_inside) continue;
    was_inside = is_inside;
    const Crossing& visible = visible_in(group);
    if (!std::isfinite(visible.hit.t)) continue;
    Hit hit = visible.hit;
    if (hit.t <= last_t) hit.t = next_up(last_t);
    last_t = hit.t;
    if ((visible.winding_change > 0) != is_inside) hit.id.triangle |= kFlippedSide;
    hits.push_back(hit);
  }
}

const CsgLine::Crossing& CsgLine::visible_in(std::span<const Crossing> group) const {
  const Crossing* visible = nullptr;
  for (const Crossing& c : group) {
    if ((previous_winding_[c.operand] != 0) == (winding_[c.operand] != 0)) continue;
    if (visible == nullptr || c.operand < visible->operand) visible = &c;
  }
  return *visible;
}

}  // namespace tessera::render
