#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/geometry/clip_line.h"
#include "worker/geometry/shapes/blobs/blob.h"
#include "worker/geometry/shapes/blobs/blob_polynomial.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Two bytes, since cells hold many.
using BlobIndex = std::uint16_t;

/// A box in which the field may cross the threshold. The blobs that contain the box are added up;
/// only those whose surface may pass through it are listed.
struct BlobCell {
  Vec3d centre, half;    // of the box
  BlobPolynomial whole;  // the sum of the blobs that contain the box
  bool has_whole = false;
  std::vector<BlobIndex> partial;  // indices of the other blobs that meet it
  FieldRange partial_range;        // contains the sum of their fields

  Vec3d local(const Vec3d& point) const { return (point - centre) / half; }
};

/// A kd-tree over the boxes of many blobs. Its leaves are cells, or lie outside or inside the
/// surface as a whole. Bounds of the field, which hold for strengths of both signs, tell these
/// apart. The cell with the most partial blobs is halved until all have few or the memory allowed
/// for each blob is used.
class BlobCells {
 public:
  static constexpr std::size_t kFew = 16;

  /// Where a leaf lies, or the index of its cell if that is less.
  static constexpr std::uint32_t kOutside = UINT32_MAX - 1, kInside = UINT32_MAX;

  /// Builds no tree for kFew blobs or fewer. Requires at most 65,536 blobs.
  BlobCells(std::span<const Blob> blobs, double threshold);

  bool empty() const { return nodes_.empty(); }
  const UnitBlob& unit(BlobIndex i) const { return units_[i]; }
  const BlobCell& cell(std::uint32_t leaf) const { return cells_[leaf]; }
  /// Contains all points of the surface; empty if there are none.
  Box3d surface_box(std::span<const Blob> blobs, double threshold) const;
  /// The cell that contains a point; null if none does. Requires a tree.
  const BlobCell* find(const Vec3d& point) const;

  /// Calls `visit(leaf, first, last)` for each leaf that the line passes through from t = first to
  /// t = last, by ascending t, until it returns false. Requires a tree. The line leaves each leaf
  /// at the t at which it enters the next.
  template <typename Visit>
  void each_along(const Vec3d& origin, const Vec3d& direction, const Visit& visit) const {
    LineSegment inside;
    if (!clip_line(box_, origin, direction, inside)) return;
    struct Step {
      std::uint32_t node;
      double first, last;
    };
    std::array<Step, kMaxDepth + 1> steps;
    std::size_t count = 0;
    steps[count++] = {0, inside.first.t, inside.last.t};
    while (count > 0) {
      const Step step = steps[--count];
      const Node& node = nodes_[step.node];
      if (node.axis == kLeaf) {
        if (step.first < step.last && !visit(node.next, step.first, step.last)) return;
        continue;
      }
      const double to_plane = node.plane - origin[node.axis], along = direction[node.axis];
      if (along == 0) {
        steps[count++] = {node.next + (to_plane > 0 ? 0 : 1), step.first, step.last};
        continue;
      }
      const std::uint32_t rises = along > 0 ? 1 : 0;
      const double split = to_plane / along;
      if (split < step.last) {
        steps[count++] = {node.next + rises, std::max(split, step.first), step.last};
      }
      if (split > step.first) {
        steps[count++] = {node.next + 1 - rises, step.first, std::min(split, step.last)};
      }
    }
  }

 private:
  static constexpr int kLeaf = 3;
  static constexpr std::size_t kMaxDepth = 200;

  struct Node {
    double plane = 0;
    std::uint32_t next = kOutside;  // the lower child, which the upper one follows, or the leaf
    int axis = kLeaf;
  };
  struct Builder;

  Box3d box_;
  std::vector<Node> nodes_;
  std::vector<BlobCell> cells_;
  std::vector<UnitBlob> units_;
};

}  // namespace tessera::render
