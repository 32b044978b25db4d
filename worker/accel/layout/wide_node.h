#pragma once

#include <cstddef>
#include <cstdint>

#include "worker/geometry/bounds.h"

namespace tessera::render {

/// Set in a child reference whose other bits are the index of a leaf.
inline constexpr std::uint32_t kLeafBit = 0x80000000u;

/// A node with up to kWidth children, one per lane. Unused lanes come last and have empty boxes
/// (lo = +inf, hi = -inf), which no ray hits.
template <int kWidth>
struct alignas(4 * kWidth) WideNode {
  /// Per axis the lower planes, then the upper ones, so that an offset selects the near planes.
  float planes[3][2 * kWidth];
  std::uint32_t children[kWidth];  // a node_reference(), or kLeafBit | leaf index

  WideNode() {
    for (int slot = 0; slot < kWidth; ++slot) set_child(slot, Box3f{}, kLeafBit);
  }

  void set_child(int slot, const Box3f& box, std::uint32_t child) {
    for (int axis = 0; axis < 3; ++axis) {
      planes[axis][slot] = box.lo[axis];
      planes[axis][kWidth + slot] = box.hi[axis];
    }
    children[slot] = child;
  }

  Box3f box(int slot) const {
    return {{planes[0][slot], planes[1][slot], planes[2][slot]},
            {planes[0][kWidth + slot], planes[1][kWidth + slot], planes[2][kWidth + slot]}};
  }
};

/// Child references count nodes in units of their alignment, so that computing an address takes a
/// shift and no multiplication. This is the size of a node in these units.
template <int kWidth>
inline constexpr std::uint32_t kNodeUnits = sizeof(WideNode<kWidth>) / alignof(WideNode<kWidth>);

/// Returns the reference of the node with this index.
template <int kWidth>
constexpr std::uint32_t node_reference(std::size_t index) {
  return static_cast<std::uint32_t>(index) * kNodeUnits<kWidth>;
}

/// Returns the node with this reference.
template <int kWidth>
inline const WideNode<kWidth>& node_at(const WideNode<kWidth>* nodes, std::uint32_t reference) {
  const auto* const bytes = reinterpret_cast<const unsigned char*>(nodes);
  return *reinterpret_cast<const WideNode<kWidth>*>(bytes + std::size_t{reference} *
                                                                alignof(WideNode<kWidth>));
}

/// Maximum number of levels of a tree, and of entries of a traversal stack, to which every level
/// adds at most kWidth - 1.
inline constexpr int kMaxLevels = 72;
template <int kWidth>
inline constexpr int kStackSize = kMaxLevels*(kWidth - 1) + kWidth;

}  // namespace tessera::render
