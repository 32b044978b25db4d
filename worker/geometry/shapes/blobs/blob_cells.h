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
#include "worker/geometry/shapes/blobs/blob_lanes.h"
#include "worker/geometry/shapes/blobs/blob_polynomial.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// A box in which the field may cross the threshold. The blobs that contain the box are added up;
/// only those whose surface may pass through it are listed.
struct BlobCell {
  Vec3d centre, half;    // of the box
  BlobPolynomial whole;  // the sum of the blobs that contain the box
  bool has_whole = false;
  /// Indices of the other blobs that meet the box, padded to a multiple of four with blobs without
  /// a field.
  std::vector<BlobIndex> partial;
  std::uint32_t partial_count = 0;
  FieldRange partial_range;  // contains the sum of the partial blobs' fields

  Vec3d local(const Vec3d& point) const { return (point - centre) / half; }
  void set_partial_count(std::size_t count, BlobIndex no_blob) {
    partial_count = static_cast<std::uint32_t>(count);
    partial.resize(count);
    partial.resize((count + 3) / 4 * 4, no_blob);
  }
};

/// A kd-tree over the boxes of many blobs. Its leaves are cells, or lie outside or inside the
/// surface as a whole. Bounds of the field, which hold for strengths of both signs, tell these
/// apart. The cell with the most partial blobs is halved until all have few or the memory allowed
/// for each blob is used.
class BlobCells {
 public:
  static constexpr std::size_t kFew = 16;

  /// Values of a leaf that lies outside or inside the surface; smaller values are indices of cells.
  static constexpr std::uint32_t kOutside = UINT32_MAX - 1, kInside = UINT32_MAX;

  /// Builds no tree for kFew blobs or fewer. Requires at most 65,535 blobs.
  BlobCells(std::span<const Blob> blobs, double threshold);

  bool empty() const { return nodes_.empty(); }
  /// The blobs at four indices. The index after that of the last blob is that of a blob without a
  /// field.
  FourBlobs four(const BlobIndex* indices) const { return {units_.data(), indices}; }
  BlobIndex no_blob() const { return static_cast<BlobIndex>(units_.size() - 1); }
  const Box3d& box() const { return box_; }
  const BlobCell& cell(std::uint32_t leaf) const { return cells_[leaf]; }
  /// Contains all points of the surface; empty if there are none.
  Box3d surface_box(std::span<const Blob> blobs, double threshold) const;
  /// The cell that contains a point; null if none does. Requires a tree.
  const BlobCell* find(const Vec3d& point) const;

  /// Calls `visit(leaf, first, last)` for each leaf that the line, clipped to `inside`, passes
  /// through from t = first to t = last >= from, by ascending t, until it returns false. Requires a
  /// tree. The line leaves each leaf at the t at which it enters the next.
  template <typename Visit>
  void each_along(const Vec3d& origin, const Vec3d& direction, const LineSegment& inside,
                  double from, const Visit& visit) const {
    struct Step {
      std::uint32_t node;
      double first, last;
    };
    std::array<Step, kMaxDepth + 1> steps;
    std::size_t count = 0;
    steps[count++] = {0, inside.first.t, inside.last.t};
    while (count > 0) {
      const Step step = steps[--count];
      if (step.last < from) continue;
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
  std::vector<UnitBlob> units_;  // and one without a field
};

}  // namespace tessera::render
