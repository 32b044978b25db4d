#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// An ellipsoid with the field strength (1 - r^2)^2 inside, where r is 0 at its centre and 1 at its
/// surface, and 0 outside. The gradient is continuous, and along a line the field is a quartic.
/// Source of the kernel: S. Murakami, H. Ichihara, "On a 3D display method by metaball technique",
/// Transactions of the IEICE J70-D(8), 1987.
struct Blob {
  Vec3d centre;
  Vec3d radii;  // above 0
  double strength = 1;
};

/// The sum of blobs and its isosurface at a threshold. Immutable.
class BlobField {
 public:
  /// Requires at least one blob and a threshold above 0.
  BlobField(std::vector<Blob> blobs, double threshold);

  double threshold() const { return threshold_; }
  /// Contains all points where the field reaches the threshold; never empty.
  const Box3d& bounds() const { return bounds_; }
  /// The field's negated gradient, which points outwards; 0 outside all blobs.
  Vec3d outward_gradient(const Vec3d& point) const;

  /// Calls `visit(blob)` for each blob for whose box, and the boxes of the nodes above it,
  /// `meets(box)` is true; always in the same order.
  template <typename Meets, typename Visit>
  void each(const Meets& meets, const Visit& visit) const {
    for (std::size_t i = 0; i < nodes_.size();) {
      const Node& node = nodes_[i];
      if (!meets(node.box)) {
        i = node.skip;
        continue;
      }
      if (node.blob != kInner) visit(blobs_[node.blob]);
      ++i;
    }
  }

 private:
  static constexpr std::uint32_t kInner = UINT32_MAX;

  /// Node of a binary tree stored in depth-first order.
  struct Node {
    Box3d box;
    std::uint32_t blob = kInner;  // the blob of a leaf
    std::uint32_t skip = 0;       // index of the next node that is not below this one
  };

  void build(std::span<std::uint32_t> blobs);
  Box3d surface_box() const;

  std::vector<Blob> blobs_;
  double threshold_;
  std::vector<Node> nodes_;
  Box3d bounds_;
};

}  // namespace tessera::render
