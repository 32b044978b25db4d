#pragma once

#include <cstdint>

#include "worker/accel/layout/wide_node.h"
#include "worker/geometry/object_ray.h"

namespace tessera::render {

/// Readable reference of kernels/node_traversal.h: recursively visits the nodes that the ray hits,
/// in storage order. Culls nodes entered after `limit`, which is read at every step. Calls
/// `leaf(index)` for each leaf and `visit()` for each node.
template <int kWidth, typename Leaf, typename Visit>
void traverse_plain(const WideNode<kWidth>* nodes, std::uint32_t reference, const ObjectRay& ray,
                    const float& limit, const Leaf& leaf, const Visit& visit) {
  const WideNode<kWidth>& node = node_at(nodes, reference);
  visit();
  for (int slot = 0; slot < kWidth; ++slot) {
    const Box3f box = node.box(slot);
    const EnterLeave t = enter_leave(ray, box.lo, box.hi);
    if (!(t.enter <= t.leave) || t.leave < 0 || t.enter > limit) continue;
    const std::uint32_t child = node.children[slot];
    if ((child & kLeafBit) != 0) {
      leaf(child & ~kLeafBit);
    } else {
      traverse_plain(nodes, child, ray, limit, leaf, visit);
    }
  }
}

}  // namespace tessera::render
