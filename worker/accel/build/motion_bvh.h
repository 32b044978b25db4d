#pragma once

#include "worker/accel/layout/scene_bvh.h"
#include "worker/accel/build/binary_bvh.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// The tree of a mesh that changes while the shutter is open, from the key `segment` to the next:
/// boxes are around all that happens in between, blocks hold both ends.
template <int kWidth>
MeshBvh<kWidth> build_moving_tree(const Mesh& mesh, std::uint32_t segment,
                                   const ParallelFor& parallel_for);

extern template MeshBvh<8> build_moving_tree<8>(const Mesh&, std::uint32_t, const ParallelFor&);
extern template MeshBvh<16> build_moving_tree<16>(const Mesh&, std::uint32_t, const ParallelFor&);

}  // namespace tessera::render
