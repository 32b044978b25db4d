#include "worker/render/spots/convex_polygon.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tessera::render {
namespace {

/// Share of the points of AroundPolygon that are in the polygon.
constexpr float kInside = 2.0f / 3;

double cross(const Vec2d& a, const Vec2d& b) {
  return a.x * b.y - a.y * b.x;
}

Vec2d between(const Vec2d& from, const Vec2d& to) {
  return {to.x - from.x, to.y - from.y};
}

/// Distance from the centre, relative to the polygon.
double distance_for(float u) {
  if (u < kInside) return std::sqrt(double{u / kInside});
  // Beyond q the share is q^-4 / 3.
  return std::sqrt(std::sqrt(double{1 - kInside} / double{1 - u}));
}

/// The part of a polygon where `height` is not negative.
template <typename Height>
std::vector<Vec2d> part_where(std::span<const Vec2d> polygon, const Height& height) {
  std::vector<Vec2d> part;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double from = height(a), to = height(b);
    if (from >= 0) part.push_back(a);
    if ((from >= 0) == (to >= 0)) continue;
    const double t = from / (from - to);
    part.push_back({a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)});
  }
  return part;
}

}  // namespace

std::vector<Vec2d> convex_hull(std::vector<Vec2d> points) {
  std::sort(points.begin(), points.end(),
            [](const Vec2d& a, const Vec2d& b) { return a.x != b.x ? a.x < b.x : a.y < b.y; });
  std::vector<Vec2d> hull;
  // The side of the lower y from left to right, then the other one back (Andrew 1979).
  for (const bool back : {false, true}) {
    const std::size_t start = hull.size();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec2d& next = points[back ? points.size() - 1 - i : i];
      while (hull.size() >= start + 2 &&
             !(cross(between(hull[hull.size() - 2], hull.back()), between(hull.back(), next)) > 0))
        hull.pop_back();
      hull.push_back(next);
    }
    if (!hull.empty()) hull.pop_back();  // it begins the other side
  }
  return hull;
}

std::vector<Vec2d> part_in_square(std::span<const Vec2d> polygon, double low, double high) {
  std::vector<Vec2d> part = part_where(polygon, [&](const Vec2d& p) { return p.x - low; });
  part = part_where(part, [&](const Vec2d& p) { return high - p.x; });
  part = part_where(part, [&](const Vec2d& p) { return p.y - low; });
  return part_where(part, [&](const Vec2d& p) { return high - p.y; });
}

double area_of(std::span<const Vec2d> polygon) {
  double twice = 0;
  for (std::size_t i = 2; i < polygon.size(); ++i)
    twice += cross(between(polygon[0], polygon[i - 1]), between(polygon[0], polygon[i]));
  return twice / 2;
}

Vec2d centre_of(std::span<const Vec2d> polygon) {
  double all = 0;
  Vec2d sum{0, 0};
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    const Vec2d a = between(polygon[0], polygon[i - 1]), b = between(polygon[0], polygon[i]);
    const double twice = cross(a, b);
    all += twice;
    sum = {sum.x + twice * (a.x + b.x), sum.y + twice * (a.y + b.y)};
  }
  return {polygon[0].x + sum.x / (3 * all), polygon[0].y + sum.y / (3 * all)};
}

Vec2f AroundPolygon::sample(const Vec2f& u) const {
  // The triangle of the centre and an edge, by area, and a point of the edge.
  double rest = double{u.y} * 2 * area_;
  Vec2d at = between(centre_, outline_.back());
  for (std::size_t i = 0; i < outline_.size(); ++i) {
    const Vec2d a = between(centre_, outline_[i]);
    const Vec2d b = between(centre_, outline_[(i + 1) % outline_.size()]);
    const double twice = cross(a, between(a, b));
    if (rest < twice) {
      const double t = rest / twice;
      at = {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
      break;
    }
    rest -= twice;
  }
  const double q = distance_for(u.x);
  return {static_cast<float>(centre_.x + q * at.x), static_cast<float>(centre_.y + q * at.y)};
}

double AroundPolygon::density(const Vec2f& point) const {
  const Vec2d to = between(centre_, {double{point.x}, double{point.y}});
  double q = 0;  // how many times the polygon would have to be larger to have the point on an edge
  for (std::size_t i = 0; i < outline_.size(); ++i) {
    const Vec2d a = between(centre_, outline_[i]);
    const Vec2d b = between(centre_, outline_[(i + 1) % outline_.size()]);
    const Vec2d edge = between(a, b);
    const double height = cross(a, edge);  // exact also for an edge that is almost a point
    if (height > 0) q = std::max(q, cross(to, edge) / height);
  }
  const double inside = double{kInside} / area_, q2 = q * q;
  return q2 < 1 ? inside : inside / (q2 * q2 * q2);
}

}  // namespace tessera::render
