#pragma once

#include "worker/accel/accel_trees.h"
#include "worker/accel/binary_bvh.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// The tree of a mesh that changes while the shutter is open, from the key `segment` to the next:
/// boxes are around all that happens in between, blocks hold both ends.
template <int kWidth>
MeshTree<kWidth> build_moving_tree(const Mesh& mesh, std::uint32_t segment,
                                   const ParallelFor& parallel_for);

extern template MeshTree<8> build_moving_tree<8>(const Mesh&, std::uint32_t, const ParallelFor&);
extern template MeshTree<16> build_moving_tree<16>(const Mesh&, std::uint32_t, const ParallelFor&);

}  // namespace tessera::render
