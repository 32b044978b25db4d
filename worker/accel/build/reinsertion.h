#pragma once

#include "worker/accel/build/binary_bvh.h"

namespace tessera::render {

/// Moves subtrees to where they make the sum of the nodes' areas least, largest subtrees first,
/// `passes` times over the tree. The result is a function of the tree alone. A tree that would get
/// more than kMaxLevels levels stays as it was. Sequential; about 2 microseconds a node and pass.
/// Source: D. Meister, J. Bittner, "Parallel reinsertion for bounding volume hierarchy
/// optimization", 2018 (its search, here one subtree after the other).
void reinsert_subtrees(BinaryBvh& bvh, int passes);

}  // namespace tessera::render
