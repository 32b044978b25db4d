#pragma once

#include "worker/accel/binary_bvh/binary_bvh.h"
#include "worker/accel/build/build_quality.h"
#include "worker/accel/layout/scene_bvh.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Builds the BVH of the triangles of a mesh that can be hit. Spatial splits may put a triangle
/// into several leaves.
template <int kWidth>
MeshBvh<kWidth> build_mesh_bvh(const Mesh& mesh, const ParallelFor& parallel_for,
                               BuildQuality quality = BuildQuality::normal);

extern template MeshBvh<8> build_mesh_bvh<8>(const Mesh&, const ParallelFor&, BuildQuality);
extern template MeshBvh<16> build_mesh_bvh<16>(const Mesh&, const ParallelFor&, BuildQuality);

}  // namespace tessera::render
