#pragma once

#include <cstddef>
#include <cstdint>

#include "worker/geometry/bounds.h"

namespace tessera::render {

/// In a child reference: the rest is the index of a leaf, not of a node.
inline constexpr std::uint32_t kLeafBit = 0x80000000u;

/// A node of up to kWidth children, one a lane. Unused lanes come last and have empty boxes (lo =
/// +inf, hi = -inf), which no ray meets.
template <int kWidth>
struct alignas(4 * kWidth) WideNode {
  /// Of each axis, the lower ones, then the upper ones: the near ones are picked by an offset.
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

/// What child references count nodes in, so that an address takes a shift and no multiplication.
template <int kWidth>
inline constexpr std::uint32_t kNodeUnits = sizeof(WideNode<kWidth>) / alignof(WideNode<kWidth>);

/// The reference of a node, from its index.
template <int kWidth>
constexpr std::uint32_t node_reference(std::size_t index) {
  return static_cast<std::uint32_t>(index) * kNodeUnits<kWidth>;
}

/// The node of a reference.
template <int kWidth>
inline const WideNode<kWidth>& node_at(const WideNode<kWidth>* nodes, std::uint32_t reference) {
  const auto* const bytes = reinterpret_cast<const unsigned char*>(nodes);
  return *reinterpret_cast<const WideNode<kWidth>*>(bytes + std::size_t{reference} *
                                                                alignof(WideNode<kWidth>));
}

/// Levels a tree may have, and entries a traversal stack may need: every level leaves at most
/// kWidth - 1 behind.
inline constexpr int kMaxLevels = 72;
template <int kWidth>
inline constexpr int kStackSize = kMaxLevels*(kWidth - 1) + kWidth;

}  // namespace tessera::render
