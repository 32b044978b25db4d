#pragma once

#include "worker/accel/binary_bvh/binary_bvh.h"

namespace tessera::render {

/// Reduces the sum of the nodes' areas by moving each subtree to its best position, largest
/// subtrees first, in `passes` passes of limited work. The result is a function of the tree alone.
/// Leaves the tree unchanged if it would exceed kMaxLevels levels. Sequential; about 2 microseconds
/// per node and pass, at most about 10 where all boxes overlap. Source: D. Meister, J. Bittner,
/// "Parallel reinsertion for bounding volume hierarchy optimization", 2018 (its search, applied to
/// one subtree after the other).
void reinsert_subtrees(BinaryBvh& bvh, int passes);

}  // namespace tessera::render
