#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/geometry/shape.h"
#include "worker/geometry/shapes/blobs/blob_field.h"

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

/// Intersection of lines with blobs. Between successive points where the line enters or leaves a
/// blob, the field is a quartic. Its Bernstein coefficients bound its values, so intervals are
/// halved until each is known to contain one root or none; no root is missed. Source: T. Nishita,
/// E. Nakamae, "A method for displaying metaballs by using Bezier clipping", Computer Graphics
/// Forum 13(3), 1994; subdivision instead of clipping.
///
/// If there are many blobs, the line goes from cell to cell. In each, the blobs that contain an
/// interval are one quartic, and the others have bounds. An interval in which the sum of both stays
/// on one side of the threshold is done. Otherwise it is halved, which narrows the bounds of the
/// quartic, or its partial blobs are tested again, which narrows theirs. Once few are left, a sweep
/// along the line adds them up exactly.
class BlobLine {
 public:
  /// As intersect_blobs().
  void intersect(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                 const HitRequest& request, std::vector<ShapeHit>& hits);
  /// intersect() of all hits by summing all blobs in all intervals: the slow reference. The hits
  /// have the same bits if the field has no cells.
  void intersect_plain(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
                       std::vector<ShapeHit>& hits);

  /// Number of blobs that the last call visited, over all intervals: a measure of its time.
  std::size_t visit_count() const { return visit_count_; }

 private:
  struct Event {
    double t;
    std::uint32_t span;
    bool enters;
  };

  /// A part of the field minus the threshold from t = first to t = last.
  struct Piece {
    double first, last;
    BernsteinQuartic b;

    Piece take_until(double t, double x);
  };

  /// Blobs that may begin or end in an interval.
  struct Partial {
    const BlobIndex* list;  // as in a BlobCell: up to a multiple of four
    std::size_t count;
    FieldRange range;  // contains the sum of their fields
    bool sifted;       // whether sifting them again would change nothing
  };

  void start(const BlobField& field, const Vec3d& origin, const Vec3d& direction,
             const HitRequest& request);
  void intersect_cells();
  void visit(const BlobCell& cell, double first, double last);
  static int side(const Piece& piece, const FieldRange& partial);
  void search(Piece piece, Partial partial);
  Partial sift(Piece& piece, const Partial& partial);
  void set_inside(bool inside, double t);
  void begin_at(const Piece& piece, const Partial& partial);

  void add_span(const Blob& blob);
  void sweep_all();
  void sweep_through(const Partial& partial, const Piece& piece);
  void sweep(Piece rest);
  void step_over(const Event& event);
  Piece next_piece(Piece& rest, double first, double last);
  void find_crossings(const Piece& whole);
  double crossing(const Piece& piece) const;
  void pass(double t);

  const BlobField* field_ = nullptr;
  Vec3d origin_, direction_;
  HitRequest request_;
  std::vector<std::vector<BlobIndex>> sifted_;  // by depth of the search
  std::size_t depth_ = 0;
  std::vector<BlobSpan> spans_;
  std::vector<Event> events_;
  std::vector<std::uint32_t> active_;  // of spans_, in the order of entry; some have been left
  std::size_t left_count_ = 0;         // how many of active_ have been left
  std::vector<Piece> pieces_;          // still to examine, the first one last
  std::vector<ShapeHit> crossings_;
  bool inside_ = false;
  bool known_ = false;  // whether inside_ holds for the start of the next piece
  bool done_ = false;   // whether no further hit is requested
  std::size_t visit_count_ = 0;
};

/// intersect_shape() for blobs. Requires an `origin` near the shape.
void intersect_blobs(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     const HitRequest& request, std::vector<ShapeHit>& hits);

}  // namespace tessera::render
