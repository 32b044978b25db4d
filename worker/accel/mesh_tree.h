#pragma once

#include "worker/accel/accel_trees.h"
#include "worker/accel/binary_bvh.h"
#include "worker/accel/build_quality.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Builds the tree of a mesh, of the triangles that can be hit. Long ones may be in several leaves.
template <int kWidth>
MeshTree<kWidth> build_mesh_tree(const Mesh& mesh, const ParallelFor& parallel_for,
                                 BuildQuality quality = BuildQuality::normal);

extern template MeshTree<8> build_mesh_tree<8>(const Mesh&, const ParallelFor&, BuildQuality);
extern template MeshTree<16> build_mesh_tree<16>(const Mesh&, const ParallelFor&, BuildQuality);

}  // namespace tessera::render
