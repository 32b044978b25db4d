#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "worker/accel/layout/packed_box.h"
#include "worker/geometry/bounds.h"

namespace tessera::render {

/// Runs body(i) for i in [0, count), in any order, on as many threads as the caller likes.
using ParallelFor =
    std::function<void(std::int64_t count, const std::function<void(std::int64_t)>& body)>;

/// Neighbouring slabs across one axis: between planes[0] and planes[1], and so on.
struct Slabs {
  int axis;
  std::span<const float> planes;
};

/// Cuts items at planes, for spatial splits.
class ItemCutter {
 public:
  virtual ~ItemCutter() = default;
  /// A box around the part of an item with lo <= x[axis] <= hi, exact but for the rounding of its
  /// planes; empty if there is none.
  virtual Box3f clip(std::uint32_t item, int axis, float lo, float hi) const = 0;
  /// Extends the box of each slab by the part of the item in it, roughly: only costs depend on it.
  virtual void chop(std::uint32_t item, const Slabs& slabs, PackedBox* parts) const = 0;
};

/// A node of a two-wide tree. Children come after their parent.
struct BinaryNode {
  Box3f box;
  std::uint32_t left = 0, right = 0;   // both 0: a leaf
  std::uint32_t first = 0, count = 0;  // of BinaryBvh::order; leaves only

  bool leaf() const { return left == 0; }
};

/// nodes[0] is the root; none without items. With spatial splits an item may be in several leaves,
/// never twice in one.
struct BinaryBvh {
  std::vector<BinaryNode> nodes;
  std::vector<std::uint32_t> order;
};

struct BinaryBvhInput {
  std::span<const Box3f> boxes;  // finite
  std::uint32_t leaf_size = 1;   // items a leaf holds at most, tested at one go
  /// Splits items where that pays: up to `split_budget` references more per item. Null: never.
  const ItemCutter* cut = nullptr;
  double split_budget = 0;
};

/// Builds by binned SAH. The result is a function of the input alone, not of threads. Any boxes:
/// equal and flat ones are split by count; at most kMaxLevels levels. Requires fewer than 2^31
/// items. O(n log n).
/// Sources: I. Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007;
/// M. Stich, H. Friedrich, A. Dietrich, "Spatial splits in bounding volume hierarchies", 2009.
BinaryBvh build_binary_bvh(const BinaryBvhInput& input, const ParallelFor& parallel_for);

}  // namespace tessera::render
