#pragma once

#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accel/layout/scene_bvh.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Builds the BVH of a mesh that deforms during the exposure, from the keyframe `segment` to the
/// next. Boxes contain the whole motion; the triangles of both keyframes are stored.
template <int kWidth>
MeshBvh<kWidth> build_moving_mesh_bvh(const Mesh& mesh, std::uint32_t segment,
                                      const ParallelFor& parallel_for);

extern template MeshBvh<8> build_moving_mesh_bvh<8>(const Mesh&, std::uint32_t, const ParallelFor&);
extern template MeshBvh<16> build_moving_mesh_bvh<16>(const Mesh&, std::uint32_t,
                                                      const ParallelFor&);

}  // namespace tessera::render
