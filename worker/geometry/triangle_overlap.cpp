#include "worker/geometry/triangle_overlap.h"

#include <utility>

#include "worker/geometry/exact_sign.h"

namespace tessera::render {
namespace {

/// An axis along which the triangle does not project to a line.
int open_axis(const TriangleCorners& t) {
  for (int axis = 0; axis < 2; ++axis) {
    if (side_of_line(t[0], t[1], t[2], axis) != 0) return axis;
  }
  return 2;
}

bool same_sign(int a, int b, int c) {
  return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
}

/// Whether p is between a and b. Requires p on the line through them.
bool is_between(const Vec3f& a, const Vec3f& b, const Vec3f& p) {
  for (int k = 0; k < 3; ++k) {
    if ((p[k] < a[k] && p[k] < b[k]) || (p[k] > a[k] && p[k] > b[k])) return false;
  }
  return true;
}

/// Whether two segments in one plane, projected along `axis`, have a point in common.
bool segments_meet(const Vec3f& p, const Vec3f& q, const Vec3f& a, const Vec3f& b, int axis) {
  const int pa = side_of_line(p, q, a, axis), pb = side_of_line(p, q, b, axis);
  const int ap = side_of_line(a, b, p, axis), aq = side_of_line(a, b, q, axis);
  if (pa * pb < 0 && ap * aq < 0) return true;
  return (pa == 0 && is_between(p, q, a)) || (pb == 0 && is_between(p, q, b)) ||
         (ap == 0 && is_between(a, b, p)) || (aq == 0 && is_between(a, b, q));
}

/// Whether a segment in the plane of the triangle meets it.
bool meets_in_plane(const Vec3f& p, const Vec3f& q, const TriangleCorners& t) {
  const int axis = open_axis(t);
  const bool inside =
      same_sign(side_of_line(t[0], t[1], p, axis), side_of_line(t[1], t[2], p, axis),
                side_of_line(t[2], t[0], p, axis));
  return inside || segments_meet(p, q, t[0], t[1], axis) || segments_meet(p, q, t[1], t[2], axis) ||
         segments_meet(p, q, t[2], t[0], axis);
}

bool segment_meets(const Vec3f& p, const Vec3f& q, const TriangleCorners& t) {
  const int from = side_of_plane(t[0], t[1], t[2], p), to = side_of_plane(t[0], t[1], t[2], q);
  if (from * to > 0) return false;
  if (from == 0 && to == 0) return meets_in_plane(p, q, t);
  return same_sign(side_of_plane(p, q, t[0], t[1]), side_of_plane(p, q, t[1], t[2]),
                   side_of_plane(p, q, t[2], t[0]));
}

bool any_edge_meets(const TriangleCorners& edges, const TriangleCorners& t) {
  return segment_meets(edges[0], edges[1], t) || segment_meets(edges[1], edges[2], t) ||
         segment_meets(edges[2], edges[0], t);
}

/// Moves shared corners to the front of both triangles; returns their number.
std::size_t match_corners(TriangleCorners& a, TriangleCorners& b) {
  std::size_t shared = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = shared; j < 3; ++j) {
      if (!(a[i] == b[j])) continue;
      std::swap(a[i], a[shared]);
      std::swap(b[j], b[shared]);
      ++shared;
      break;
    }
  }
  return shared;
}

}  // namespace

bool triangles_overlap(const TriangleCorners& first, const TriangleCorners& second) {
  TriangleCorners a = first, b = second;
  switch (match_corners(a, b)) {
    case 0:
      return any_edge_meets(a, b) || any_edge_meets(b, a);
    case 1:
      // If they meet away from the shared corner, they do so along a segment from it that ends on
      // the opposite edge of one of them.
      return segment_meets(a[1], a[2], b) || segment_meets(b[1], b[2], a);
    case 2: {
      if (side_of_plane(a[0], a[1], a[2], b[2]) != 0) return false;
      const int axis = open_axis(a);
      return side_of_line(a[0], a[1], a[2], axis) == side_of_line(a[0], a[1], b[2], axis);
    }
    default:
      return true;
  }
}

}  // namespace tessera::render
