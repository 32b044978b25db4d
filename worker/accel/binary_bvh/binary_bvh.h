#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "worker/accel/layout/packed_box.h"
#include "worker/geometry/bounds.h"

namespace tessera::render {

/// Runs body(i) for each i in [0, count), in any order and on any number of threads.
using ParallelFor =
    std::function<void(std::int64_t count, const std::function<void(std::int64_t)>& body)>;

/// A ParallelFor that runs its body on the calling thread, in order.
ParallelFor sequential();

/// Adjacent slabs perpendicular to one axis: slab i is between planes[i] and planes[i + 1].
struct Slabs {
  int axis;
  std::span<const float> planes;
};

/// Clips items at planes, for spatial splits.
class ItemCutter {
 public:
  virtual ~ItemCutter() = default;
  /// Returns the bounding box, up to rounding, of the part of an item with lo <= x[axis] <= hi.
  /// Empty if there is no such part.
  virtual Box3f clip(std::uint32_t item, int axis, float lo, float hi) const = 0;
  /// Extends the box of each slab by the part of the item in it. May be approximate: only cost
  /// estimates depend on it.
  virtual void chop(std::uint32_t item, const Slabs& slabs, PackedBox* parts) const = 0;
};

/// A node of a binary tree. Children come after their parent.
struct BinaryNode {
  Box3f box;
  std::uint32_t left = 0, right = 0;   // both 0: a leaf
  std::uint32_t first = 0, count = 0;  // of BinaryBvh::order; leaves only

  bool leaf() const { return left == 0; }
};

/// nodes[0] is the root; without items there are no nodes. With spatial splits an item may be in
/// several leaves, but only once in each.
struct BinaryBvh {
  std::vector<BinaryNode> nodes;
  std::vector<std::uint32_t> order;
};

struct BinaryBvhInput {
  std::span<const Box3f> boxes;  // finite
  std::uint32_t leaf_size = 1;   // maximum number of items in a leaf, which are tested together
  /// Splits items where that reduces the cost, adding up to `split_budget` references per item on
  /// average. Null: items are not split.
  const ItemCutter* cut = nullptr;
  double split_budget = 0;
};

/// Builds a BVH by binned SAH. The result is a function of the input alone, not of the threads.
/// Items whose centres coincide are split by count, so the tree has at most kMaxLevels levels.
/// Requires fewer than 2^31 items. O(n log n).
/// Sources: I. Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007;
/// M. Stich, H. Friedrich, A. Dietrich, "Spatial splits in bounding volume hierarchies", 2009.
BinaryBvh build_binary_bvh(const BinaryBvhInput& input, const ParallelFor& parallel_for);

}  // namespace tessera::render
