#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/geometry/shapes/blob_field.h"
#include "worker/geometry/shapes/shape.h"

namespace tessera::render {

/// The part of a line inside a blob, in the space in which the blob is the unit sphere.
struct BlobSpan {
  double nearest = 0;  // t of the point nearest to the centre
  Vec3d point;         // that point
  Vec3d direction;
  double strength = 0;
  bool entered = false;  // whether the sweep along the line is in the blob

  Vec3d at(double t) const { return point + direction * (t - nearest); }
};

/// Coefficients of a quartic, by ascending power.
using Quartic = std::array<double, 5>;

/// The sum of the fields of some blobs along a line as a quartic of the distance from a point that
/// moves along, with a bound on its rounding errors. All operations take the same time for any
/// number of blobs.
class BlobSum {
 public:
  /// The sum of no blobs, at t.
  void clear(double t);
  /// Moves on to t. Requires t not before the current point.
  void move_to(double t);
  /// Adds `sign` (1 or -1) times the field of a blob that contains the current point.
  void add(const BlobSpan& span, double sign);
  /// Whether all exact values from the current point to t are more than `margin` above the
  /// threshold, or with `above` false below it. May be false without need.
  bool stays(bool above, double t, double threshold, double margin) const;

 private:
  Quartic sum_{};
  Quartic error_{};  // the error at distance x is at most the value of this quartic at x
  double t_ = 0;
};

/// Intersection of lines with blobs. Between successive points where the line enters or leaves a
/// blob, the field is a quartic. Its Bernstein coefficients bound its values, so intervals are
/// halved until each is known to contain one root or none; no root is missed. Source: T. Nishita,
/// E. Nakamae, "A method for displaying metaballs by using Bezier clipping", Computer Graphics
/// Forum 13(3), 1994; subdivision instead of clipping.
///
/// The quartic of n overlapping blobs takes O(n) time, so examining all O(n) intervals takes
/// O(n^2). A running sum, updated at each point, shows that most intervals contain no root; only
/// the others are examined. Hits have the same bits either way.
class BlobLine {
 public:
  /// As intersect_blobs(). With `plain`, examines all blobs and intervals: the slow reference.
  void intersect(const BlobField& field, const Vec3d& origin, const Vec3d& direction, bool plain,
                 std::vector<ShapeHit>& hits);

  /// How many blobs the last intersect() summed over, over all intervals: a measure of its time.
  std::size_t term_count() const { return term_count_; }

 private:
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

  static Piece take_half(Piece& piece, double middle);
  void find_spans(const BlobField& field, const Vec3d& origin, const Vec3d& direction, bool plain);
  void sweep(double threshold, bool plain);
  void step_over(const Event& event);
  bool has_no_crossing(double first, double last, double threshold);
  Piece field_between(double first, double last, double threshold);
  void find_crossings(const Piece& whole);
  double crossing(const Piece& piece) const;

  /// The line passes through the surface at t.
  void pass(double t) {
    inside_ = !inside_;
    crossings_.push_back(t);
  }

  std::vector<BlobSpan> spans_;
  std::vector<Event> events_;
  std::vector<std::uint32_t> active_;  // of spans_, in the order of entry; some have been left
  std::size_t left_count_ = 0;         // how many of active_ have been left
  BlobSum sum_;                        // of the spans of active_ that have not been left
  bool sum_valid_ = false;
  double strengths_ = 0;       // sum of the magnitudes of all spans' strengths
  std::vector<Piece> pieces_;  // still to examine, the first one last
  std::vector<double> crossings_;
  bool inside_ = false;
  std::size_t term_count_ = 0;
};

}  // namespace tessera::render
