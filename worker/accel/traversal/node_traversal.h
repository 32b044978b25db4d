#pragma once

#include "worker/accel/traversal/dependencies.h"

// Traversal of the nodes of one BVH by one ray. `Isa` is Avx2 or Avx512, or derives from one.

namespace tessera::render::kernels {

/// Reference of a tree's root node.
inline constexpr std::uint32_t kRootNode = 0;

/// Scales of the leave distance of nodes, which is computed in one fused step and widened by more
/// than that of triangles: the triangle's, fma((plane - o) * inverse, kLeaveScale, slack), has at
/// most two roundings more, and it matters only while it is not negative. 2^-20 of the product and
/// 2^-18 of the slack exceed those roundings.
inline constexpr float kNodeLeaveScale = 1 + 0x1p-19f;
inline constexpr float kNodeSlackScale = 1 + 0x1p-18f;

/// Slab test of a ray against all boxes of a node, as enter_leave() of geometry/object_ray.h.
template <typename Isa>
struct NodeTest {
  using Lanes = typename Isa::Lanes;

  Lanes origin[3], inverse[3], widened_inverse[3], slack;
  std::size_t near[3];  // offset of the near planes in WideNode::planes[axis], in floats

  explicit NodeTest(const ObjectRay& ray) : slack(Isa::splat(ray.slack * kNodeSlackScale)) {
    const float o[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
    const float inv[3] = {ray.inverse.x, ray.inverse.y, ray.inverse.z};
    for (int k = 0; k < 3; ++k) {
      origin[k] = Isa::splat(o[k]);
      inverse[k] = Isa::splat(inv[k]);
      widened_inverse[k] = Isa::splat(inv[k] * kNodeLeaveScale);
      near[k] = ray.backwards[static_cast<std::size_t>(k)] != 0 ? Isa::kWidth : 0;
    }
  }

  /// Returns the lanes with enter <= min(leave, limit) and leave >= 0; `enters` gets
  /// max(enter, 0).
  std::uint32_t intersect(const WideNode<Isa::kWidth>& node, float limit, Lanes& enters) const {
    Lanes enter = Isa::splat(0);
    Lanes leave = Isa::splat(limit);
    for (int k = 0; k < 3; ++k) {
      const float* const planes = node.planes[k];
      const Lanes near_plane = Isa::load(planes + near[k]);
      const Lanes far_plane = Isa::load(planes + (Isa::kWidth - near[k]));
      enter = Isa::max(enter, (near_plane - origin[k]) * inverse[k]);
      leave = Isa::min(leave,
                       Isa::fused_multiply_add(far_plane - origin[k], widened_inverse[k], slack));
    }
    enters = enter;
    return Isa::less_equal_mask(enter, leave);
  }
};

/// Memory of a TraversalStack, apart from it so that the stack itself stays in registers.
template <typename Isa>
struct StackMemory {
  float enters[kStackSize<Isa::kWidth>];  // lower bounds of the distances of entry
  std::uint32_t children[kStackSize<Isa::kWidth>];
};

/// Children still to visit; the last is next.
template <typename Isa>
class TraversalStack {
 public:
  using Lanes = typename Isa::Lanes;
  using Node = WideNode<Isa::kWidth>;

  explicit TraversalStack(StackMemory<Isa>& memory)
      : enters_(memory.enters), children_(memory.children) {}

  /// Pushes the children in `mask` except the nearest, which it returns; the next nearest is on
  /// top. Requires two to four lanes. Free of branches, since the order is unpredictable.
  std::uint32_t push_few(const Node& node, std::uint32_t mask, Lanes enters) {
    const auto count = static_cast<std::size_t>(__builtin_popcount(mask));
    const typename Isa::ChildOrder order(enters);
    const __m128i packed = order.compress_keys(mask);
    const std::uint32_t nearest = node.children[min_of_four(packed) & (Isa::kWidth - 1)];
    const __m128i sorted = sort_four(packed);
    const __m128i control = _mm_load_si128(reinterpret_cast<const __m128i*>(kReversed[count - 2]));
    const __m128i pushed = _mm_shuffle_epi8(sorted, control);
    const __m128i lane_bits = _mm_set1_epi32(Isa::kWidth - 1);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(enters_ + top_),
                     _mm_andnot_si128(lane_bits, pushed));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(children_ + top_),
                     Isa::gather_children(node, _mm_and_si128(lane_bits, pushed)));
    top_ += count - 1;
    return nearest;
  }

  /// The same for two or more lanes. Each lane's position is the number of nearer lanes.
  std::uint32_t push_many(const Node& node, std::uint32_t mask, Lanes enters) {
    alignas(64) float enter[Isa::kWidth];
    Isa::store(enter, enters);
    const typename Isa::ChildOrder order(enters);
    const std::size_t last = top_ + static_cast<std::size_t>(__builtin_popcount(mask)) - 1;
    for (std::uint32_t rest = mask; rest != 0; rest &= rest - 1) {
      const int lane = __builtin_ctz(rest);
      const std::size_t place =
          last - static_cast<std::size_t>(__builtin_popcount(order.nearer(lane) & mask));
      enters_[place] = enter[lane];
      children_[place] = node.children[lane];
    }
    top_ = last;
    return children_[last];
  }

  /// Pushes the children in `mask` except one, which it returns, in no particular order and without
  /// distances. Requires at least one lane.
  std::uint32_t push_unordered(const Node& node, std::uint32_t mask) {
    const std::uint32_t rest = mask & (mask - 1);
    Isa::store_compressed(children_ + top_, node.children, rest);
    top_ += static_cast<std::size_t>(__builtin_popcount(rest));
    return node.children[__builtin_ctz(mask)];
  }

  /// Pops a child; returns false if the stack is empty.
  bool pop_any(std::uint32_t& child) {
    if (top_ == 0) return false;
    child = children_[--top_];
    return true;
  }

  /// Pops the next child entered at `limit` or before; returns false if there is none.
  bool pop(float limit, std::uint32_t& child) {
    while (top_ > 0) {
      --top_;
      if (enters_[top_] > limit) continue;
      child = children_[top_];
      return true;
    }
    return false;
  }

 private:
  /// Sorts four unsigned numbers in ascending order.
  static __m128i sort_four(__m128i k) {
    __m128i other = _mm_shuffle_epi32(k, _MM_SHUFFLE(1, 0, 3, 2));
    k = _mm_blend_epi32(_mm_min_epu32(k, other), _mm_max_epu32(k, other), 0b1100);
    other = _mm_shuffle_epi32(k, _MM_SHUFFLE(2, 3, 0, 1));
    k = _mm_blend_epi32(_mm_min_epu32(k, other), _mm_max_epu32(k, other), 0b1010);
    other = _mm_shuffle_epi32(k, _MM_SHUFFLE(3, 1, 2, 0));
    return _mm_blend_epi32(_mm_min_epu32(k, other), _mm_max_epu32(k, other), 0b0100);
  }

  /// The smallest of four unsigned numbers.
  static std::uint32_t min_of_four(__m128i k) {
    k = _mm_min_epu32(k, _mm_shuffle_epi32(k, _MM_SHUFFLE(1, 0, 3, 2)));
    k = _mm_min_epu32(k, _mm_shuffle_epi32(k, _MM_SHUFFLE(2, 3, 0, 1)));
    return static_cast<std::uint32_t>(_mm_cvtsi128_si32(k));
  }

  /// Controls of _mm_shuffle_epi8: row n - 2 takes elements n - 1 down to 1 of four.
  alignas(16) static constexpr std::uint8_t kReversed[3][16] = {
      {4, 5, 6, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0},
      {8, 9, 10, 11, 4, 5, 6, 7, 0, 0, 0, 0, 0, 0, 0, 0},
      {12, 13, 14, 15, 8, 9, 10, 11, 4, 5, 6, 7, 0, 0, 0, 0}};

  float* enters_;
  std::uint32_t* children_;
  std::size_t top_ = 0;
};

/// Prefetches the start of the node or leaf that comes next. Called before the branch that tells
/// them apart, so that the memory is on its way if the branch is mispredicted.
template <typename Isa, typename LeafData>
inline void prefetch(const WideNode<Isa::kWidth>* nodes, const LeafData* leaves,
                     std::uint32_t child) {
  const std::size_t index = child & ~kLeafBit;
  const void* const leaf = leaves + index;
  const void* const at = (child & kLeafBit) != 0 ? leaf : &node_at(nodes, child & ~kLeafBit);
  _mm_prefetch(at, _MM_HINT_T0);
  _mm_prefetch(static_cast<const char*>(at) + 64, _MM_HINT_T0);
}

/// Visits `child` and the nodes below it that the ray meets, the nearest child first. Calls
/// `leaf(index, limit)` for each leaf; it may lower the limit, beyond which nodes are culled, and
/// ends the traversal by returning true. Returns whether it did.
template <typename Query, typename LeafData, typename Leaf>
inline __attribute__((always_inline)) bool traverse_nearest(
    const WideNode<Query::Isa::kWidth>* nodes, const LeafData* leaves, std::uint32_t child,
    const ObjectRay& ray, float limit, Leaf&& leaf) {
  using Isa = typename Query::Isa;
  const NodeTest<Isa> test(ray);
  StackMemory<Isa> memory;
  TraversalStack<Isa> stack(memory);
  do {
    while ((child & kLeafBit) == 0) {
      const WideNode<Isa::kWidth>& node = node_at(nodes, child);
      Query::count_node();
      typename Isa::Lanes enters;
      const std::uint32_t mask = test.intersect(node, limit, enters);
      if (mask == 0) {
        if (!stack.pop(limit, child)) return false;
        continue;
      }
      if ((mask & (mask - 1)) == 0) {
        child = node.children[__builtin_ctz(mask)];
      } else if (__builtin_popcount(mask) <= 4) {
        child = stack.push_few(node, mask, enters);
      } else {
        child = stack.push_many(node, mask, enters);
      }
      prefetch<Isa>(nodes, leaves, child);
    }
    if (leaf(child & ~kLeafBit, limit)) return true;
  } while (stack.pop(limit, child));
  return false;
}

/// The same in no particular order, for a limit that does not change.
template <typename Query, typename Leaf>
inline __attribute__((always_inline)) bool traverse_any(const WideNode<Query::Isa::kWidth>* nodes,
                                                        std::uint32_t child, const ObjectRay& ray,
                                                        float limit, Leaf&& leaf) {
  using Isa = typename Query::Isa;
  const NodeTest<Isa> test(ray);
  StackMemory<Isa> memory;
  TraversalStack<Isa> stack(memory);
  do {
    while ((child & kLeafBit) == 0) {
      const WideNode<Isa::kWidth>& node = node_at(nodes, child);
      Query::count_node();
      typename Isa::Lanes enters;
      const std::uint32_t mask = test.intersect(node, limit, enters);
      if (mask == 0) {
        if (!stack.pop_any(child)) return false;
        continue;
      }
      child = stack.push_unordered(node, mask);
    }
    if (leaf(child & ~kLeafBit, limit)) return true;
  } while (stack.pop_any(child));
  return false;
}

/// Runs traverse_nearest() or traverse_any(), as the query requires.
template <typename Query, typename LeafData, typename Leaf>
inline __attribute__((always_inline)) bool traverse(const WideNode<Query::Isa::kWidth>* nodes,
                                                    const LeafData* leaves, std::uint32_t child,
                                                    const ObjectRay& ray, float limit,
                                                    Leaf&& leaf) {
  if constexpr (Query::kOrdered) {
    return traverse_nearest<Query>(nodes, leaves, child, ray, limit, leaf);
  } else {
    return traverse_any<Query>(nodes, child, ray, limit, leaf);
  }
}

}  // namespace tessera::render::kernels
