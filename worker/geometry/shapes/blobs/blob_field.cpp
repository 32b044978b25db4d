#include "worker/geometry/shapes/blobs/blob_field.h"

#include <algorithm>
#include <utility>

namespace tessera::render {
namespace {

bool overlap(const Box3d& a, const Box3d& b) {
  return a.lo.x <= b.hi.x && b.lo.x <= a.hi.x && a.lo.y <= b.hi.y && b.lo.y <= a.hi.y &&
         a.lo.z <= b.hi.z && b.lo.z <= a.hi.z;
}

}  // namespace

BlobField::BlobField(std::vector<Blob> blobs, double threshold)
    : blobs_(std::move(blobs)), threshold_(threshold), cells_(blobs_, threshold) {
  bounds_ = cells_.empty() ? surface_box() : cells_.surface_box(blobs_, threshold);
  if (!bounds_.empty()) return;
  for (const Blob& blob : blobs_) bounds_.extend(blob.box(1));
}

/// At a point where the field reaches the threshold T, let S be the sum of the strengths of the
/// positive blobs there. One of these has (1 - r^2)^2 >= T / S, or else the field would be below T.
/// All of them meet its box, so S is at most the sum over all positive blobs that do.
Box3d BlobField::surface_box() const {
  Box3d out;
  for (const Blob& blob : blobs_) {
    if (!(blob.strength > 0)) continue;
    const Box3d box = blob.box(1);
    double strengths = 0;
    for (const Blob& other : blobs_) {
      if (overlap(box, other.box(1))) strengths += std::max(other.strength, 0.0);
    }
    out.extend(blob.box_above(threshold_ / strengths));
  }
  return out;
}

/// A point in no cell is not on the surface, but rounding may have moved it there.
Vec3d BlobField::outward_gradient(const Vec3d& point) const {
  const BlobCell* cell = cells_.empty() ? nullptr : cells_.find(point);
  Vec3d sum;
  if (cell == nullptr) {
    for (const Blob& blob : blobs_) sum += blob.outward_gradient(point);
    return sum;
  }
  if (cell->has_whole) sum = -cell->whole.gradient(cell->local(point)) / cell->half;
  const BlobVectors at = spread(point);
  BlobVectors sums{};
  for (std::size_t i = 0; i < cell->partial.size(); i += 4) {
    const FourBlobs blobs = cells_.four(&cell->partial[i]);
    const BlobVectors p = blobs.local(at);
    sums += p * blobs.scale * (4.0 * blobs.strength * larger(one_less_dot(p, p), spread(0)));
  }
  return sum + Vec3d{total(sums.x), total(sums.y), total(sums.z)};
}

}  // namespace tessera::render
