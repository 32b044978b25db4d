#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "worker/geometry/shapes/blob_line.h"

namespace tessera::render {
namespace {

/// From this number of overlapping blobs on, the running sum costs less than the pieces that it
/// saves.
constexpr std::size_t kSumPays = 12;

/// The value and the slope at x in [0, 1], by de Casteljau's algorithm.
std::array<double, 2> value_and_slope(std::array<double, 5> b, double x) {
  for (std::size_t n = 4; n > 1; --n) {
    for (std::size_t i = 0; i < n; ++i) b[i] += (b[i + 1] - b[i]) * x;
  }
  return {b[0] + (b[1] - b[0]) * x, 4 * (b[1] - b[0])};
}

}  // namespace

/// Splits a piece at `middle`: returns the first half and sets `piece` to the second.
BlobLine::Piece BlobLine::take_half(Piece& piece, double middle) {
  Piece half = piece;
  half.last = piece.first = middle;
  for (std::size_t n = 4; n > 0; --n) {
    half.b[4 - n] = piece.b[0];
    for (std::size_t i = 0; i < n; ++i) piece.b[i] = 0.5 * (piece.b[i] + piece.b[i + 1]);
  }
  half.b[4] = piece.b[0];
  return half;
}

void BlobLine::find_spans(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                          bool plain) {
  spans_.clear();
  events_.clear();
  strengths_ = 0;
  const Vec3d along = absolute(direction);
  // Separating axes: the cross products of the line with the box's edges. The slack covers the
  // rounding of both sides, which is at most 8 u of `size`.
  const auto meets = [&](const Box3d& box) {
    if (plain) return true;
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
    strengths_ += std::fabs(span.strength);
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

/// The field of the blobs of active_. Each 1 - |p|^2 is a quadratic with the Bernstein coefficients
/// 1 - p.p, 1 - p.q, 1 - q.q for its ends p and q, without cancellation; those of its square
/// follow. Source: Farouki, Rajan, "Algorithms for polynomials in Bernstein form", Computer Aided
/// Geometric Design 5(1), 1988.
BlobLine::Piece BlobLine::field_between(double first, double last, double threshold) {
  term_count_ += active_.size();
  Piece whole = {first, last, {}};
  whole.b.fill(-threshold);
  for (const std::uint32_t i : active_) {
    const BlobSpan& span = spans_[i];
    if (!span.entered) continue;
    const Vec3d p = span.at(first), q = span.at(last);
    const double start = 1 - dot(p, p), middle = 1 - dot(p, q), end = 1 - dot(q, q);
    whole.b[0] += span.strength * (start * start);
    whole.b[1] += span.strength * (start * middle);
    whole.b[2] += span.strength * ((start * end + 2 * middle * middle) / 3);
    whole.b[3] += span.strength * (middle * end);
    whole.b[4] += span.strength * (end * end);
  }
  return whole;
}

void BlobLine::find_crossings(const Piece& whole) {
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

/// Whether find_crossings() is known to find nothing between first and last. It finds nothing if
/// b[4] of the whole and of every half that it may examine has the sign of inside_: an odd number
/// of sign changes then cannot occur. b[4] is the field minus the threshold, with these errors:
/// field_between() rounds each blob's part by at most 70 u of its strength, and the sum once per
/// blob; each of at most 1,100 halvings adds 4 u. The magnitudes are at most 8/3 of the strengths
/// plus the threshold.
bool BlobLine::has_no_crossing(double first, double last, double threshold) {
  if (active_.size() - left_count_ < kSumPays) {
    sum_valid_ = false;
    return false;
  }
  const double margin =
      (static_cast<double>(spans_.size()) + 0x1p13) * 0x1p-53 * (3 * strengths_ + threshold);
  const auto clear = [&] { return sum_.stays(inside_, last, threshold, margin); };
  if (sum_valid_ && clear()) return true;
  // A new sum has no errors left from blobs that the line has passed.
  term_count_ += active_.size();
  sum_valid_ = true;
  sum_.clear(first);
  for (const std::uint32_t i : active_) {
    if (spans_[i].entered) sum_.add(spans_[i], 1);
  }
  return clear();
}

void BlobLine::step_over(const Event& event) {
  BlobSpan& span = spans_[event.span];
  if (sum_valid_) {
    sum_.move_to(event.t);
    sum_.add(span, event.enters ? 1 : -1);
  }
  span.entered = event.enters;
  if (event.enters) {
    active_.push_back(event.span);
    return;
  }
  // Removed together when they are half of all, which takes constant time for each.
  if (2 * ++left_count_ < active_.size()) return;
  std::erase_if(active_, [&](std::uint32_t i) { return !spans_[i].entered; });
  left_count_ = 0;
}

void BlobLine::sweep(double threshold, bool plain) {
  active_.clear();
  left_count_ = 0;
  sum_valid_ = inside_ = false;
  crossings_.clear();
  std::sort(events_.begin(), events_.end(), [](const Event& a, const Event& b) {
    return std::tie(a.t, a.span, b.enters) < std::tie(b.t, b.span, a.enters);
  });
  double last = 0;
  for (const Event& event : events_) {
    const bool overlap = !active_.empty() && last < event.t;
    if (overlap && (plain || !has_no_crossing(last, event.t, threshold))) {
      find_crossings(field_between(last, event.t, threshold));
    }
    last = event.t;
    step_over(event);
    if (active_.empty() && inside_) pass(last);  // the field is 0 behind the last blob
  }
}

void BlobLine::intersect(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                         bool plain, std::vector<ShapeHit>& hits) {
  term_count_ = 0;
  find_spans(field, origin, direction, plain);
  sweep(field.threshold(), plain);
  for (std::size_t i = 0; i < crossings_.size(); ++i) {
    const double t = crossings_[i];
    hits.push_back({t, origin + direction * t, kCurvedFace, i % 2 == 0});
  }
}

void intersect_blobs(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits) {
  thread_local BlobLine line;
  line.intersect(*shape.blobs, origin, direction, false, hits);
}

}  // namespace tessera::render
