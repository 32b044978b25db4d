#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "worker/accel/lanes.h"
#include "worker/accel/wide_bvh.h"
#include "worker/geometry/object_ray.h"

namespace tessera::render {

/// Eight boxes at once by enter_leave() of geometry/object_ray.h: the lanes with
/// enter <= min(leave, limit) and leave >= 0. `enters` gets max(enter, 0).
class NodeTest {
 public:
  explicit NodeTest(const ObjectRay& ray)
      : origin_{splat(ray.origin.x), splat(ray.origin.y), splat(ray.origin.z)},
        inverse_{splat(ray.inverse.x), splat(ray.inverse.y), splat(ray.inverse.z)},
        slack_(splat(ray.slack)),
        near_{ray.backwards[0], ray.backwards[1], ray.backwards[2]} {}

  std::uint32_t operator()(const WideNode& node, float limit, float* enters) const {
    Lanes enter = _mm256_setzero_ps();
    Lanes leave = splat(std::numeric_limits<float>::infinity());
    for (std::size_t k = 0; k < 3; ++k) {
      const Lanes near = load(node.planes[k][near_[k]].data());
      const Lanes far = load(node.planes[k][1 - near_[k]].data());
      enter = greater(enter, (near - origin_[k]) * inverse_[k]);
      leave = lesser(leave, (far - origin_[k]) * inverse_[k]);
    }
    leave = fused_multiply_add(leave, splat(kLeaveScale), slack_);
    _mm256_store_ps(enters, enter);
    return bits(_mm256_cmp_ps(enter, lesser(leave, splat(limit)), _CMP_LE_OQ));
  }

 private:
  Lanes origin_[3], inverse_[3];
  Lanes slack_;
  std::size_t near_[3];
};

/// Children still to visit; the last is next.
class TraversalStack {
 public:
  /// Adds the children of the lanes in `met`, the nearest on top.
  void push(const WideNode& node, std::uint32_t met, const float* enters) {
    const int base = top_;
    for (; met != 0; met &= met - 1) {
      const int lane = __builtin_ctz(met);
      int place = top_++;
      for (; place > base && entries_[place - 1].enter < enters[lane]; --place) {
        entries_[place] = entries_[place - 1];
      }
      entries_[place] = {enters[lane], node.children[static_cast<std::size_t>(lane)]};
    }
  }

  /// Takes the next child that is not entered after `limit`; false if there is none.
  bool pop(float limit, std::uint32_t& child) {
    while (top_ > 0) {
      --top_;
      if (entries_[top_].enter > limit) continue;
      child = entries_[top_].child;
      return true;
    }
    return false;
  }

 private:
  struct Entry {
    float enter;
    std::uint32_t child;
  };
  Entry entries_[kStackSize];
  int top_ = 0;
};

/// Walks the nodes the ray meets, nearest child first, without recursion. `limit` is read anew at
/// every step: nodes are culled only if they are entered after it. `leaf(index)` is called for
/// each leaf met; true ends the walk, and is returned. `visit()` is called once a node.
template <typename Leaf, typename Visit>
bool traverse(const WideNode* nodes, const ObjectRay& ray, const float& limit, Leaf&& leaf,
              Visit&& visit) {
  TraversalStack stack;
  std::uint32_t child = 0;
  const NodeTest test(ray);
  do {
    while ((child & kLeafBit) == 0) {
      visit();
      const WideNode& node = nodes[child];
      alignas(32) float enters[kWidth];
      const std::uint32_t met = test(node, limit, enters);
      if (met != 0 && (met & (met - 1)) == 0) {  // one child, the usual case: no stack
        child = node.children[static_cast<std::size_t>(__builtin_ctz(met))];
        continue;
      }
      stack.push(node, met, enters);
      if (!stack.pop(limit, child)) return false;
    }
    if (leaf(child & ~kLeafBit)) return true;
  } while (stack.pop(limit, child));
  return false;
}

}  // namespace tessera::render
