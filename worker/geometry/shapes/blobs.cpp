// Intersection of a line with blobs. Between successive points where the line enters or leaves a
// blob, the field is a quartic. Its Bernstein coefficients bound its values, so intervals are
// halved until each is known to contain one root or none; no root is missed. Source: T. Nishita, E.
// Nakamae, "A method for displaying metaballs by using Bezier clipping", Computer Graphics Forum
// 13(3), 1994; subdivision instead of clipping.

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "worker/geometry/shapes/blob_field.h"
#include "worker/geometry/shapes/shape.h"

namespace tessera::render {
namespace {

/// The part of the line inside a blob, in the space in which the blob is the unit sphere.
struct BlobSpan {
  double nearest = 0;  // t of the point nearest to the centre
  Vec3d point;         // that point
  Vec3d direction;
  double strength = 0;

  Vec3d at(double t) const { return point + direction * (t - nearest); }
};

struct Event {
  double t;
  std::uint32_t span;
  bool enters;
};

/// The field minus the threshold from t = first to t = last.
struct Piece {
  double first, last;
  std::array<double, 5> b;  // Bernstein coefficients
};

/// The value and the slope at x in [0, 1], by de Casteljau's algorithm.
std::array<double, 2> value_and_slope(std::array<double, 5> b, double x) {
  for (std::size_t n = 4; n > 1; --n) {
    for (std::size_t i = 0; i < n; ++i) b[i] += (b[i + 1] - b[i]) * x;
  }
  return {b[0] + (b[1] - b[0]) * x, 4 * (b[1] - b[0])};
}

/// Splits a piece at `middle`: returns the first half and sets `piece` to the second.
Piece take_half(Piece& piece, double middle) {
  Piece half = piece;
  half.last = piece.first = middle;
  for (std::size_t n = 4; n > 0; --n) {
    half.b[4 - n] = piece.b[0];
    for (std::size_t i = 0; i < n; ++i) piece.b[i] = 0.5 * (piece.b[i] + piece.b[i + 1]);
  }
  half.b[4] = piece.b[0];
  return half;
}

class BlobLine {
 public:
  void intersect(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                 std::vector<ShapeHit>& hits);

 private:
  void find_spans(const BlobField& field, const Vec3d& origin, const Vec3d& direction);
  void find_crossings(double first, double last, double threshold);
  double crossing(const Piece& piece) const;

  /// The line passes through the surface at t.
  void pass(double t) {
    inside_ = !inside_;
    crossings_.push_back(t);
  }

  std::vector<BlobSpan> spans_;
  std::vector<Event> events_;
  std::vector<std::uint32_t> active_;  // of spans_
  std::vector<Piece> pieces_;          // still to examine, the first one last
  std::vector<double> crossings_;
  bool inside_ = false;
};

void BlobLine::find_spans(const BlobField& field, const Vec3d& origin, const Vec3d& direction) {
  const auto absolute = [](const Vec3d& v) {
    return Vec3d{std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)};
  };
  const Vec3d along = absolute(direction);
  // Separating axes: the cross products of the line with the box's edges. The slack covers the
  // rounding of both sides, which is at most 8 u of `size`.
  const auto meets = [&](const Box3d& box) {
    const Vec3d half = (box.hi - box.lo) * 0.5, to = (box.lo + box.hi) * 0.5 - origin;
    const Vec3d apart = absolute(cross(to, direction));
    const Vec3d reach = absolute(to) + half;
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      const double size = reach[i] * along[j] + reach[j] * along[i];
      if (apart[k] > half[i] * along[j] + half[j] * along[i] + 0x1p-49 * size) return false;
    }
    return true;
  };
  field.each(meets, [&](const Blob& blob) {
    BlobSpan span;
    span.direction = direction / blob.radii;
    span.strength = blob.strength;
    const Vec3d from = (origin - blob.centre) / blob.radii;
    const double size2 = dot(span.direction, span.direction);
    span.nearest = -dot(from, span.direction) / size2;
    span.point = from + span.direction * span.nearest;
    const double left = 1 - dot(span.point, span.point);
    if (!(left > 0)) return;
    const double half = std::sqrt(left / size2);
    const auto index = static_cast<std::uint32_t>(spans_.size());
    events_.push_back({span.nearest - half, index, true});
    events_.push_back({span.nearest + half, index, false});
    spans_.push_back(span);
  });
}

/// Root of a piece with one sign change, by Newton's method safeguarded by bisection.
double BlobLine::crossing(const Piece& piece) const {
  double low = 0, high = 1, x = 0.5, step = 1;
  for (;;) {
    const auto [value, slope] = value_and_slope(piece.b, x);
    ((value > 0) == inside_ ? low : high) = x;
    double next = x - value / slope;
    const bool shrinks = std::fabs(next - x) <= 0.5 * step;
    if (!(shrinks && next >= low && next <= high)) next = 0.5 * (low + high);
    step = std::fabs(next - x);
    x = next;
    if (step <= 0x1p-53) break;
  }
  return std::min(piece.first + (piece.last - piece.first) * x, piece.last);
}

/// Finds the crossings between first and last, where the blobs of active_ are. Each 1 - |p|^2 is a
/// quadratic with the Bernstein coefficients 1 - p.p, 1 - p.q, 1 - q.q for its ends p and q,
/// without cancellation; those of its square follow. Source: Farouki, Rajan, "Algorithms for
/// polynomials in Bernstein form", Computer Aided Geometric Design 5(1), 1988.
void BlobLine::find_crossings(double first, double last, double threshold) {
  Piece whole = {first, last, {}};
  whole.b.fill(-threshold);
  for (const std::uint32_t i : active_) {
    const BlobSpan& span = spans_[i];
    const Vec3d p = span.at(first), q = span.at(last);
    const double start = 1 - dot(p, p), middle = 1 - dot(p, q), end = 1 - dot(q, q);
    whole.b[0] += span.strength * (start * start);
    whole.b[1] += span.strength * (start * middle);
    whole.b[2] += span.strength * ((start * end + 2 * middle * middle) / 3);
    whole.b[3] += span.strength * (middle * end);
    whole.b[4] += span.strength * (end * end);
  }
  pieces_.assign(1, whole);
  while (!pieces_.empty()) {
    Piece piece = pieces_.back();
    pieces_.pop_back();
    // The sign at the start is that of inside_, not that of the rounded b[0].
    int changes = 0;
    bool above = inside_;
    for (std::size_t i = 1; i < 5; ++i) {
      changes += (piece.b[i] > 0) != above ? 1 : 0;
      above = piece.b[i] > 0;
    }
    if (changes == 0) continue;
    if (changes == 1) {
      pass(crossing(piece));
      continue;
    }
    const double middle = 0.5 * (piece.first + piece.last);
    if (!(piece.first < middle && middle < piece.last)) {
      if (above != inside_) pass(middle);
      continue;
    }
    const Piece half = take_half(piece, middle);
    pieces_.push_back(piece);
    pieces_.push_back(half);
  }
}

void BlobLine::intersect(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                         std::vector<ShapeHit>& hits) {
  spans_.clear();
  events_.clear();
  active_.clear();
  crossings_.clear();
  inside_ = false;
  find_spans(field, origin, direction);
  std::sort(events_.begin(), events_.end(), [](const Event& a, const Event& b) {
    return std::tie(a.t, a.span, b.enters) < std::tie(b.t, b.span, a.enters);
  });
  double last = 0;
  for (const Event& event : events_) {
    if (!active_.empty() && last < event.t) find_crossings(last, event.t, field.threshold());
    last = event.t;
    if (event.enters) {
      active_.push_back(event.span);
    } else {
      std::erase(active_, event.span);
    }
    if (active_.empty() && inside_) pass(last);  // the field is 0 behind the last blob
  }
  for (std::size_t i = 0; i < crossings_.size(); ++i) {
    const double t = crossings_[i];
    hits.push_back({t, origin + direction * t, kCurvedFace, i % 2 == 0});
  }
}

}  // namespace

void intersect_blobs(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits) {
  thread_local BlobLine line;
  line.intersect(*shape.blobs, origin, direction, hits);
}

}  // namespace tessera::render
