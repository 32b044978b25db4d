#pragma once

#include <optional>

#include "worker/accel/layout/scene_bvh.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// The tree of `mesh` with the nodes and leaves of `before`, the tree of the same triangles
/// elsewhere (a frame of an animation earlier): about a tenth of the time a new one takes. Null
/// where that will not do: other triangles can be hit, or the tree would be worse by SAH than when
/// it was built by more than a twentieth, which costs more in any but the smallest renders than
/// building does.
template <int kWidth>
std::optional<MeshBvh<kWidth>> refit_mesh_tree(const MeshBvh<kWidth>& before, const Mesh& mesh);

extern template std::optional<MeshBvh<8>> refit_mesh_tree<8>(const MeshBvh<8>&, const Mesh&);
extern template std::optional<MeshBvh<16>> refit_mesh_tree<16>(const MeshBvh<16>&, const Mesh&);

}  // namespace tessera::render
