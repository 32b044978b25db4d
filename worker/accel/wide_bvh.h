#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "worker/geometry/bounds.h"

namespace tessera::render {

/// Runs body(i) for i in [0, count), in any order, on as many threads as the caller likes.
using ParallelFor =
    std::function<void(std::int64_t count, const std::function<void(std::int64_t)>& body)>;

/// Children per node: the lanes of an AVX register.
inline constexpr int kWidth = 8;

/// Most entries a traversal stack may need: every level leaves at most kWidth - 1 behind.
inline constexpr int kStackSize = 512;

/// A node of up to eight children, planes in lanes. Unused children have empty boxes (lo = +inf,
/// hi = -inf), which no ray meets.
struct alignas(32) WideNode {
  /// Planes as [axis][0: lo, 1: hi][child], so that the near one is picked by a sign bit.
  std::array<std::array<std::array<float, kWidth>, 2>, 3> planes;
  /// A node index, or kLeafBit | leaf index.
  std::array<std::uint32_t, kWidth> children;
};

inline constexpr std::uint32_t kLeafBit = 0x80000000u;

/// Items [first, first + count) of WideBvh::order.
struct BvhLeaf {
  std::uint32_t first = 0, count = 0;
};

/// A bounding volume hierarchy over boxes, with its items in leaf order. nodes[0] is the root;
/// without items it has no children.
struct WideBvh {
  std::vector<WideNode> nodes;
  std::vector<BvhLeaf> leaves;
  std::vector<std::uint32_t> order;
  Box3f bounds;
};

/// Builds by binned SAH, in object splits, and collapses to eight children a node. The result is
/// a function of `boxes` and `leaf_size` alone, not of threads. Any input: equal and empty-volume
/// boxes are split by count, and depth is bounded so that kStackSize suffices.
///
/// Requires finite boxes, 1 <= leaf_size <= 8, fewer than 2^31 boxes. O(n log n).
/// Source: I. Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007.
WideBvh build_wide_bvh(std::span<const Box3f> boxes, std::uint32_t leaf_size,
                       const ParallelFor& parallel_for);

}  // namespace tessera::render
