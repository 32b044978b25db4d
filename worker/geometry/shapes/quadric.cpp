// Intersection of a line with a quadric clipped to a box.

#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "worker/geometry/clip_line.h"
#include "worker/geometry/shapes/intersect_shape.h"

namespace tessera::render {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Finds up to two segments with a t^2 + 2 b t + c <= 0, by ascending t; returns their number. The
/// root that would suffer from cancellation is computed from the product of both.
/// Source: PBR 4e, section 6.1 and B.2.10.
int inside_segments(double a, double b, double c, std::array<LineSegment, 2>& out) {
  const LineSegment everywhere = {{-kInfinity, kCurvedFace}, {kInfinity, kCurvedFace}};
  out[0] = out[1] = everywhere;
  if (a == 0) {
    if (b == 0) return c <= 0 ? 1 : 0;
    const double root = -c / (2 * b);
    (b > 0 ? out[0].last : out[0].first).t = root;
    return 1;
  }
  const double discriminant = difference_of_products(b, b, a, c);
  if (discriminant < 0) return a < 0 ? 1 : 0;
  const double q = -(b + std::copysign(std::sqrt(discriminant), b));
  double low = q / a, high = q == 0 ? 0 : c / q;
  if (low > high) std::swap(low, high);
  if (!(low <= high)) return 0;  // NaN
  if (a > 0) {
    out[0] = {{low, kCurvedFace}, {high, kCurvedFace}};
    return 1;
  }
  out[0].last.t = low;
  out[1].first.t = high;
  return 2;
}

}  // namespace

void intersect_quadric(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                       std::vector<ShapeHit>& hits) {
  LineSegment box;
  if (!clip_line(shape.clip, origin, direction, box)) return;
  const Quadric& q = shape.quadric;
  const Vec3d turned = q.times(direction);
  const double a = dot(direction, turned);
  const double b = dot(origin, turned) + dot(q.linear, direction);
  std::array<LineSegment, 2> segments;
  const int count = inside_segments(a, b, q.at(origin), segments);
  const int flat = shape.flat_axis();
  const auto add = [&](const LineEnd& end, bool enters) {
    if (end.face == kCurvedFace ? std::isinf(end.t) : !shape.capped) return;
    hits.push_back({end.t, end_point(shape.clip, origin, direction, end), end.face, enters});
  };
  for (int i = 0; i < count; ++i) {
    const auto& [first, last] = segments[static_cast<std::size_t>(i)];
    const LineEnd start = first.t >= box.first.t ? first : box.first;
    const LineEnd end = last.t <= box.last.t ? last : box.last;
    // If two segments meet in an apex, one of length zero would report it twice.
    if (!(start.t <= end.t) || (count == 2 && start.t == end.t)) continue;
    if (flat >= 0) {
      add({start.t, static_cast<std::uint32_t>(2 + 2 * flat)}, direction[flat] < 0);
      return;
    }
    add(start, true);
    add(end, false);
  }
}

}  // namespace tessera::render
