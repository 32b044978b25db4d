#pragma once

#include "worker/accel/layout/scene_bvh.h"
#include "worker/accel/build/binary_bvh.h"
#include "worker/accel/build/build_quality.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Builds the tree of a mesh, of the triangles that can be hit. Long ones may be in several leaves.
template <int kWidth>
MeshBvh<kWidth> build_mesh_tree(const Mesh& mesh, const ParallelFor& parallel_for,
                                 BuildQuality quality = BuildQuality::normal);

extern template MeshBvh<8> build_mesh_tree<8>(const Mesh&, const ParallelFor&, BuildQuality);
extern template MeshBvh<16> build_mesh_tree<16>(const Mesh&, const ParallelFor&, BuildQuality);

}  // namespace tessera::render
