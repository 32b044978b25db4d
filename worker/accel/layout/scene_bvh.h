#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "worker/accel/layout/huge_array.h"
#include "worker/accel/solids/solids.h"
#include "worker/accel/layout/triangle_block.h"
#include "worker/accel/layout/wide_node.h"
#include "worker/geometry/ray.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// The tree of one mesh, in its object space. A leaf is a block.
template <int kWidth>
struct MeshBvh {
  HugeArray<WideNode<kWidth>> nodes;
  HugeArray<TriangleBlock> blocks;
  HugeArray<TriangleBlock> end_blocks;    // at the next key, of a mesh that changes; else empty
  std::vector<std::uint32_t> first_rank;  // of each primitive, and one past the last
  Box3f bounds;
  bool split = false;                // whether a triangle may be in several leaves
  std::uint32_t triangle_count = 0;  // of those that can be hit
  double built_sah = 0;              // sah_of() it when it was built, not refitted

  /// The id of a triangle of this mesh, from its rank.
  TriangleId id(std::uint32_t instance, std::uint32_t rank) const {
    const auto next = std::upper_bound(first_rank.begin(), first_rank.end(), rank);
    const auto primitive = static_cast<std::uint32_t>(next - first_rank.begin()) - 1;
    return {instance, primitive, rank - first_rank[primitive]};
  }
  /// The rank of a triangle; UINT32_MAX if the mesh has no such triangle.
  std::uint32_t rank(const TriangleId& id) const {
    if (id.primitive + std::size_t{1} >= first_rank.size()) return UINT32_MAX;
    const std::uint32_t first = first_rank[id.primitive], next = first_rank[id.primitive + 1];
    return id.triangle < next - first ? first + id.triangle : UINT32_MAX;
  }
};

inline constexpr std::uint32_t kNoMotion = UINT32_MAX;

/// A mesh in the world, or a solid.
struct PlacedMesh {
  Affine3d world_to_object;
  std::uint32_t mesh = 0, instance = 0;
  bool identity = false;
  std::uint32_t solid = kNoSolid;    // if any, of SceneBvh::solids, in the place of the mesh
  std::uint32_t motion = kNoMotion;  // if any, of SceneBvh::motions
};

/// All that a traversal reads: a tree over placed meshes, and those of the meshes. A leaf of the
/// former is an element of `placed`.
template <int kWidth>
struct SceneBvh {
  std::vector<MeshBvh<kWidth>> meshes;
  std::vector<PlacedMesh> placed;
  HugeArray<WideNode<kWidth>> nodes;
  std::shared_ptr<const Solids> solids;          // null in a scene without
  std::vector<std::array<Affine3d, 2>> motions;  // object to world at the keys before and after
  Box3f bounds;                                  // of the padded boxes of the placed meshes
  float origin_limit = 0;                        // the pads hold for origins within this, per axis
  bool single = false;  // whether one placed mesh is all there is: its tree alone will do
};

/// What moves while the shutter is open: trees of it for each time from one key to the next, with
/// boxes around all that happens in between. What stands still is apart from it, and held once.
template <int kWidth>
struct MotionBvh {
  std::vector<float> times;                  // of keys; empty if nothing moves
  std::vector<SceneBvh<kWidth>> segments;  // one less
};

}  // namespace tessera::render
