#include "worker/geometry/shapes/blobs/blob_line.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace tessera::render {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The value and the slope at x in [0, 1], by de Casteljau's algorithm.
std::array<double, 2> value_and_slope(BernsteinQuartic b, double x) {
  for (std::size_t n = 4; n > 1; --n) {
    for (std::size_t i = 0; i < n; ++i) b[i] += (b[i + 1] - b[i]) * x;
  }
  return {b[0] + (b[1] - b[0]) * x, 4 * (b[1] - b[0])};
}

bool is_constant(const BernsteinQuartic& b) {
  return b[0] == b[1] && b[0] == b[2] && b[0] == b[3] && b[0] == b[4];
}

/// A quadratic 1 - |p|^2 by its Bernstein coefficients between the points p and q. There is no
/// cancellation, and those of its square follow. Source: Farouki, Rajan, "Algorithms for
/// polynomials in Bernstein form", Computer Aided Geometric Design 5(1), 1988.
struct BlobQuadratic {
  double start, middle, end;

  BlobQuadratic(const Vec3d& p, const Vec3d& q)
      : start(1 - dot(p, p)), middle(1 - dot(p, q)), end(1 - dot(q, q)) {}

  void add_square(BernsteinQuartic& b, double strength) const {
    b[0] += strength * (start * start);
    b[1] += strength * (start * middle);
    b[2] += strength * ((start * end + 2 * middle * middle) / 3);
    b[3] += strength * (middle * end);
    b[4] += strength * (end * end);
  }
};

/// Sorts blobs, four at a time, into those that contain a segment, those that miss it and others.
class Sieve {
 public:
  /// Adds the first to the sum and the others to the range; returns the bits of the others.
  std::uint32_t sift(const FourBlobs& blobs, const BlobVectors& start, const BlobVectors& end) {
    const BlobLanes none = spread(0);
    const BlobVectors p = blobs.local(start), q = blobs.local(end);
    const BlobLanes u = one_less_dot(p, p), v = one_less_dot(p, q), w = one_less_dot(q, q);
    const BlobLanes around = only(at_least(u, none), at_least(w, none));
    const BlobLanes weight = only(around, blobs.strength);
    const BlobLanes su = weight * u, sv = weight * v, sw = weight * w;
    sum_[0] = add_product(sum_[0], su, u);
    sum_[1] = add_product(sum_[1], su, v);
    sum_[2] = add_product(sum_[2], su, w);
    middle_ = add_product(middle_, sv, v);
    sum_[3] = add_product(sum_[3], sv, w);
    sum_[4] = add_product(sum_[4], sw, w);
    const BlobLanes most = larger(larger(u, v), w);
    const BlobLanes others = without(around, above(most, none));
    const BlobLanes greatest = only(others, blobs.strength * (most * most));
    low_ += smaller(greatest, none);
    high_ += larger(greatest, none);
    return bits(others);
  }

  /// Bernstein coefficients of squares, as in BlobQuadratic.
  void add_to(BernsteinQuartic& b) const {
    for (std::size_t k = 0; k < 5; ++k) {
      b[k] += k == 2 ? total(sum_[k] + 2.0 * middle_) / 3 : total(sum_[k]);
    }
  }
  FieldRange range() const { return {total(low_), total(high_)}; }

 private:
  std::array<BlobLanes, 5> sum_{};
  BlobLanes middle_{}, low_{}, high_{};
};

}  // namespace

/// Splits the piece at t, which is `x` of its length from its start: returns the first part and
/// keeps the second.
BlobLine::Piece BlobLine::Piece::take_until(double t, double x) {
  Piece part = {first, t, {}};
  first = t;
  for (std::size_t n = 4; n > 0; --n) {
    part.b[4 - n] = b[0];
    for (std::size_t i = 0; i < n; ++i) b[i] = (1 - x) * b[i] + x * b[i + 1];
  }
  part.b[4] = b[0];
  return part;
}

/// The line passes through the surface at t.
void BlobLine::pass(double t) {
  if (done_) return;
  inside_ = !inside_;
  crossings_.push_back({t, origin_ + direction_ * t, kCurvedFace, inside_});
  done_ = request_.first && t >= request_.from;
}

void BlobLine::set_inside(bool inside, double t) {
  if (!known_) inside_ = inside;
  known_ = true;
  if (inside_ != inside) pass(t);
}

void BlobLine::add_span(const Blob& blob) {
  ++visit_count_;
  BlobSpan span;
  span.direction = direction_ / blob.radii;
  span.strength = blob.strength;
  const Vec3d from = (origin_ - blob.centre) / blob.radii;
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

void BlobLine::find_crossings(const Piece& whole) {
  pieces_.assign(1, whole);
  while (!pieces_.empty() && !done_) {
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
    const Piece half = piece.take_until(middle, 0.5);
    pieces_.push_back(piece);
    pieces_.push_back(half);
  }
}

/// Takes the next part of `rest`, which ends at `last`, and adds the blobs of active_.
BlobLine::Piece BlobLine::next_piece(Piece& rest, double first, double last) {
  Piece whole = {first, last, rest.b};
  if (!is_constant(rest.b)) {
    whole = last < rest.last ? rest.take_until(last, (last - rest.first) / (rest.last - rest.first))
                             : rest;
  }
  visit_count_ += active_.size();
  for (const std::uint32_t i : active_) {
    const BlobSpan& span = spans_[i];
    if (!span.entered) continue;
    BlobQuadratic(span.at(first), span.at(last)).add_square(whole.b, span.strength);
  }
  return whole;
}

void BlobLine::step_over(const Event& event) {
  spans_[event.span].entered = event.enters;
  if (event.enters) {
    active_.push_back(event.span);
    return;
  }
  // Removed together when they are half of all, which takes constant time for each.
  if (2 * ++left_count_ < active_.size()) return;
  std::erase_if(active_, [&](std::uint32_t i) { return !spans_[i].entered; });
  left_count_ = 0;
}

/// Finds the crossings of the sum of `rest` and the blobs of spans_.
void BlobLine::sweep(Piece rest) {
  active_.clear();
  left_count_ = 0;
  std::sort(events_.begin(), events_.end(), [](const Event& a, const Event& b) {
    return std::tie(a.t, a.span, b.enters) < std::tie(b.t, b.span, a.enters);
  });
  const bool alone = is_constant(rest.b);
  double last = rest.first;
  for (const Event& event : events_) {
    if (done_) return;
    const double t = std::clamp(event.t, last, rest.last);
    if (last < t && !(alone && active_.empty())) find_crossings(next_piece(rest, last, t));
    last = t;
    if (event.t > rest.last) return;
    step_over(event);
    if (alone && active_.empty() && inside_) pass(last);  // the field is 0 behind the last blob
  }
  if (last < rest.last && !alone && !done_) find_crossings(rest);
}

/// Finds the crossings of the sum of a piece and partial blobs.
void BlobLine::sweep_through(const Partial& partial, const Piece& piece) {
  spans_.clear();
  events_.clear();
  for (std::size_t i = 0; i < partial.count; ++i) add_span(field_->blobs()[partial.list[i]]);
  sweep(piece);
}

/// Sifts partial blobs around a piece: adds those that contain it to the piece and returns those
/// that neither contain nor miss it.
BlobLine::Partial BlobLine::sift(Piece& piece, const Partial& partial) {
  visit_count_ += partial.count;
  if (sifted_.size() <= depth_) sifted_.emplace_back();
  std::vector<BlobIndex>& kept = sifted_[depth_];
  if (kept.size() < partial.count + 8) kept.resize(partial.count + 8);
  const BlobVectors start = spread(origin_ + direction_ * piece.first);
  const BlobVectors end = spread(origin_ + direction_ * piece.last);
  const BlobIndex* from = partial.list;
  BlobIndex* to = kept.data();
  Sieve sieve;
  for (std::size_t i = 0; i < partial.count; i += 4, from += 4) {
    to = copy_chosen(from, sieve.sift(field_->cells().four(from), start, end), to);
  }
  sieve.add_to(piece.b);
  std::fill_n(to, 3, field_->cells().no_blob());
  return {kept.data(), static_cast<std::size_t>(to - kept.data()), sieve.range(), true};
}

/// 1 or -1 if all values of a piece and of partial blobs are above or below the threshold, else 0.
int BlobLine::side(const Piece& piece, const FieldRange& partial) {
  const auto& b = piece.b;
  const auto [low, high] = std::minmax({b[0], b[1], b[2], b[3], b[4]});
  return low + partial.low > 0 ? 1 : high + partial.high < 0 ? -1 : 0;
}

/// Makes inside_ hold for the start of a piece, if what lies before it was skipped.
void BlobLine::begin_at(const Piece& piece, const Partial& partial) {
  if (known_) return;
  visit_count_ += partial.count;
  const BlobVectors start = spread(origin_ + direction_ * piece.first);
  BlobLanes sum{};
  for (std::size_t i = 0; i < partial.count; i += 4) {
    const FourBlobs blobs = field_->cells().four(partial.list + i);
    const BlobVectors p = blobs.local(start);
    const BlobLanes left = larger(one_less_dot(p, p), spread(0));
    sum += blobs.strength * (left * left);
  }
  inside_ = piece.b[0] + total(sum) > 0;
  known_ = true;
}

/// Finds the crossings of the sum of a piece and partial blobs. A list is long, so it is sifted
/// only where neither half of the piece can be decided without.
void BlobLine::search(Piece piece, Partial partial) {
  if (piece.first > request_.to) done_ = true;
  if (done_) return;
  if (piece.last < request_.from) {
    known_ = false;
    return;
  }
  if (const int found = side(piece, partial.range); found != 0) {
    return set_inside(found > 0, piece.first);
  }
  const double middle = 0.5 * (piece.first + piece.last);
  const bool few = partial.count <= BlobField::kFew;
  if ((few && partial.sifted) || !(piece.first < middle && middle < piece.last)) {
    begin_at(piece, partial);
    return partial.count == 0 ? find_crossings(piece) : sweep_through(partial, piece);
  }
  Piece second = piece;
  const Piece first = second.take_until(middle, 0.5);
  if (!few &&
      (partial.sifted || side(first, partial.range) != 0 || side(second, partial.range) != 0)) {
    partial.sifted = false;
    search(first, partial);
    return search(second, partial);
  }
  const Partial sifted = sift(piece, partial);
  ++depth_;
  search(piece, sifted);
  --depth_;
}

/// Finds the crossings of a line in a cell.
void BlobLine::visit(const BlobCell& cell, double first, double last) {
  Piece piece = {first, last, {}};
  if (cell.has_whole) {
    piece.b = cell.whole.along(cell.local(origin_ + direction_ * first),
                               cell.local(origin_ + direction_ * last));
  }
  for (double& b : piece.b) b -= field_->threshold();
  const std::size_t count = cell.partial_count;
  search(piece, {cell.partial.data(), count, cell.partial_range, count == 0});
}

void BlobLine::intersect_cells() {
  const BlobCells& cells = field_->cells();
  LineSegment inside;
  if (!clip_line(cells.box(), origin_, direction_, inside)) return;
  known_ = !(inside.first.t < request_.from);  // a line begins outside all blobs
  cells.each_along(origin_, direction_, inside, request_.from,
                   [&](std::uint32_t leaf, double first, double last) {
                     if (first > request_.to) done_ = true;
                     if (done_) return false;
                     if (leaf < BlobCells::kOutside) {
                       visit(cells.cell(leaf), first, last);
                     } else {
                       set_inside(leaf == BlobCells::kInside, first);
                     }
                     return !done_;
                   });
  if (known_ && inside_) pass(inside.last.t);  // the field is 0 outside all cells
}

void BlobLine::start(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                     const HitRequest& request) {
  field_ = &field;
  origin_ = origin;
  direction_ = direction;
  request_ = request;
  spans_.clear();
  events_.clear();
  crossings_.clear();
  inside_ = done_ = false;
  known_ = true;
  depth_ = 0;
  visit_count_ = 0;
}

void BlobLine::sweep_all() {
  for (const Blob& blob : field_->blobs()) add_span(blob);
  Piece whole = {-kInfinity, kInfinity, {}};
  whole.b.fill(-field_->threshold());
  sweep(whole);
}

void BlobLine::intersect(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                         const HitRequest& request, std::vector<ShapeHit>& hits) {
  start(field, origin, direction, request);
  field.cells().empty() ? sweep_all() : intersect_cells();
  hits.insert(hits.end(), crossings_.begin(), crossings_.end());
}

void BlobLine::intersect_plain(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                               std::vector<ShapeHit>& hits) {
  start(field, origin, direction, {});
  sweep_all();
  hits.insert(hits.end(), crossings_.begin(), crossings_.end());
}

void intersect_blobs(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     const HitRequest& request, std::vector<ShapeHit>& hits) {
  thread_local BlobLine line;
  line.intersect(*shape.blobs, origin, direction, request, hits);
}

}  // namespace tessera::render
