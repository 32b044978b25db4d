#pragma once

#include <optional>

#include "worker/accel/layout/scene_bvh.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Refits `before`, the BVH of the same triangles at other positions (the previous frame of an
/// animation), to `mesh`. Takes about a tenth of the time of building. Returns nullopt if the set
/// of triangles that can be hit has changed, or if the SAH cost exceeds that of the originally
/// built tree by more than 5 %: then slower tracing outweighs the time saved, except in very small
/// renders.
template <int kWidth>
std::optional<MeshBvh<kWidth>> refit_mesh_bvh(const MeshBvh<kWidth>& before, const Mesh& mesh);

extern template std::optional<MeshBvh<8>> refit_mesh_bvh<8>(const MeshBvh<8>&, const Mesh&);
extern template std::optional<MeshBvh<16>> refit_mesh_bvh<16>(const MeshBvh<16>&, const Mesh&);

}  // namespace tessera::render
