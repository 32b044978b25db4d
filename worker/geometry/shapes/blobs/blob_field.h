#pragma once

#include <cstddef>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/geometry/shapes/blobs/blob.h"
#include "worker/geometry/shapes/blobs/blob_cells.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// The sum of blobs and its isosurface at a threshold. Immutable.
class BlobField {
 public:
  /// Fields of more blobs have cells.
  static constexpr std::size_t kFew = BlobCells::kFew;

  /// Requires at least one blob and a threshold above 0.
  BlobField(std::vector<Blob> blobs, double threshold);

  const std::vector<Blob>& blobs() const { return blobs_; }
  double threshold() const { return threshold_; }
  const BlobCells& cells() const { return cells_; }
  /// Contains all points where the field reaches the threshold; never empty.
  const Box3d& bounds() const { return bounds_; }
  /// The field's negated gradient, which points outwards; 0 outside all blobs.
  Vec3d outward_gradient(const Vec3d& point) const;

 private:
  Box3d surface_box() const;

  std::vector<Blob> blobs_;
  double threshold_;
  BlobCells cells_;
  Box3d bounds_;
};

}  // namespace tessera::render
