// Intersection of a line with a height field. A quadtree of minimum and maximum heights skips
// segments in which the line is certainly above or below the ground. In the remaining segments,
// affine bounds of the clearance, whose error shrinks with the square of the segment's length,
// narrow down where it can be zero, to the precision of double. A segment that is shorter than the
// field's precision and has both ends on one side is dropped; a segment in which the line changes
// sides never is. The precision follows the size of the resolved detail, as in F. K. Musgrave,
// "QAEB rendering for procedural models" (Texturing & Modeling: A Procedural Approach, 3rd edition,
// 2003, chapter 17).

#include "worker/geometry/shapes/terrain/terrain_line.h"

#include <algorithm>
#include <cmath>

#include "worker/geometry/clip_line.h"
#include "worker/geometry/shapes/terrain/terrain_field.h"

namespace tessera::render {
namespace {

class TerrainLine {
 public:
  TerrainLine(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
              const HitRequest& request, std::vector<ShapeHit>& hits)
      : shape_(shape),
        field_(*shape.terrain),
        origin_(origin),
        direction_(direction),
        length_(std::sqrt(dot(direction, direction))),
        request_(request),
        hits_(hits) {}

  void intersect();

 private:
  struct Cell {
    int level;
    std::size_t column, row;
  };

  Vec2d ground(double t) const {
    return {origin_.x + direction_.x * t, origin_.z + direction_.z * t};
  }
  double height(double t) const { return origin_.y + direction_.y * t; }
  bool below(double t) {
    return field_.clearance<0>({height(t), {}, 0}, ground(t), {}, cells_).centre < 0;
  }

  /// Records that the line is on this side from t on; adds a hit if the side changes.
  void settle(double t, bool inside);
  void walk(const Cell& cell, double first, double last);
  void find(double first, double last);

  const Shape& shape_;
  const TerrainField& field_;
  Vec3d origin_, direction_;
  double length_;
  HitRequest request_;
  double least_ = 0;  // length in t at which a segment counts as a point
  bool inside_ = false;
  bool done_ = false;  // whether no further hits are requested
  TerrainCells cells_;
  std::vector<ShapeHit>& hits_;
};

void TerrainLine::settle(double t, bool inside) {
  if (inside == inside_) return;
  inside_ = inside;
  // The height is that of the ground, because y(t) is rounded relative to the distance from the
  // origin, which may exceed the height of almost flat terrain by any factor.
  Vec3d point = origin_ + direction_ * t;
  point.y = field_.height({point.x, point.z});
  hits_.push_back({t, point, kCurvedFace, inside});
  done_ = request_.first;
}

/// Finds the crossings from t = first to t = last, where the line is over the cell.
void TerrainLine::walk(const Cell& cell, double first, double last) {
  if (done_ || first > request_.to) return;
  const double start = height(first), end = height(last), slack = field_.rounding();
  const TerrainField::Range& range = field_.range(cell.level, cell.column, cell.row);
  if (std::min(start, end) > double{range.high} + slack) return settle(first, false);
  if (std::max(start, end) < double{range.low} - slack) return settle(first, true);
  if (cell.level + 1 == field_.levels()) return find(first, last);
  // Visits the cell's quarters along the line: up to three, separated by two planes.
  const Vec2d size = field_.form().size;
  const double share = 1 / static_cast<double>(std::size_t{1} << cell.level);
  const double x = ((static_cast<double>(cell.column) + 0.5) * share - 0.5) * size.x;
  const double z = ((static_cast<double>(cell.row) + 0.5) * share - 0.5) * size.y;
  double planes[2] = {(x - origin_.x) / direction_.x, (z - origin_.z) / direction_.z};
  if (planes[0] > planes[1]) std::swap(planes[0], planes[1]);
  double from = first;
  for (int k = 0; k < 3; ++k) {
    double to = last;
    if (k < 2) {
      if (!(planes[k] > from && planes[k] < last)) continue;  // none, or parallel to it
      to = planes[k];
    }
    const Vec2d middle = ground(0.5 * (from + to));
    walk({cell.level + 1, 2 * cell.column + (middle.x > x ? 1 : 0),
          2 * cell.row + (middle.y > z ? 1 : 0)},
         from, to);
    from = to;
  }
}

void TerrainLine::find(double first, double last) {
  if (done_) return;
  const double middle = 0.5 * (first + last), half = 0.5 * (last - first);
  const AffineForm<1> above =
      field_.clearance<1>({height(middle), {direction_.y * half}, 0}, ground(middle),
                          {Vec2d{direction_.x * half, direction_.z * half}}, cells_);
  // The part of [-1, 1] in which the clearance can be 0.
  const double c = above.centre, s = above.slope[0], e = above.error;
  double low = -1, high = 1;
  if (s != 0) {
    low = std::max((s > 0 ? -c - e : c - e) / std::fabs(s), -1.0);
    high = std::min((s > 0 ? -c + e : c + e) / std::fabs(s), 1.0);
  }
  if (low > high || (s == 0 && std::fabs(c) > e)) return settle(first, c < 0);
  const double from = low > -1 ? middle + half * low : first;
  const double to = high < 1 ? middle + half * high : last;
  if (low > -1) settle(first, s > 0);
  const double length = to - from, centre = 0.5 * (from + to);
  const bool resolved = length <= least_ || e <= 2 * field_.rounding();
  bool end = s < 0;  // whether the line is below the ground after that part
  if (high >= 1 && (resolved || length * length_ <= field_.precision(ground(centre)))) {
    end = below(last);
  }
  const bool passes = end != inside_;
  if (resolved) {
    settle(centre, end);
  } else if (passes || length * length_ > field_.precision(ground(centre))) {
    if (length < half) {
      find(from, to);
    } else {
      find(from, centre);
      find(centre, to);
    }
    // Where t is too coarse for the height, the crossing may be lost in rounding.
    if (high < 1 && !done_) settle(to, end);
  }
}

void TerrainLine::intersect() {
  LineSegment box;
  if (!clip_line(shape_.clip, origin_, direction_, box)) return;
  if (!(box.last.t > request_.from && box.first.t <= request_.to)) return;
  if (request_.from > box.first.t) box.first = {request_.from, kCurvedFace};
  least_ = (box.last.t - box.first.t) * 0x1p-46;
  const auto add_end = [&](const LineEnd& end, bool enters) {
    if (!shape_.capped || end.face == kCurvedFace) return;
    hits_.push_back({end.t, end_point(shape_.clip, origin_, direction_, end), end.face, enters});
  };
  inside_ = below(box.first.t);
  if (inside_) add_end(box.first, true);
  walk({0, 0, 0}, box.first.t, box.last.t);
  if (inside_ && !done_) add_end(box.last, false);
}

}  // namespace

void intersect_terrain(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                       const HitRequest& request, std::vector<ShapeHit>& hits) {
  TerrainLine(shape, origin, direction, request, hits).intersect();
}

}  // namespace tessera::render
