#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "worker/accel/layout/huge_array.h"
#include "worker/accel/layout/triangle_block.h"
#include "worker/accel/layout/wide_node.h"
#include "worker/accel/solids/solids.h"
#include "worker/geometry/ray.h"
#include "worker/math/transform.h"

namespace tessera::render {

/// The BVH of one mesh, in its object space. Each leaf is one block.
template <int kWidth>
struct MeshBvh {
  HugeArray<WideNode<kWidth>> nodes;
  HugeArray<TriangleBlock> blocks;
  HugeArray<TriangleBlock> end_blocks;    // blocks at the next keyframe, if the mesh deforms
  std::vector<std::uint32_t> first_rank;  // by primitive, then the number of all triangles
  Box3f bounds;
  bool split = false;                // whether a triangle may be in several leaves
  std::uint32_t triangle_count = 0;  // triangles that can be hit
  double built_sah = 0;              // sah_cost() when it was built, before any refitting

  /// Returns the id of the triangle with this rank.
  TriangleId id(std::uint32_t instance, std::uint32_t rank) const {
    const auto next = std::upper_bound(first_rank.begin(), first_rank.end(), rank);
    const auto primitive = static_cast<std::uint32_t>(next - first_rank.begin()) - 1;
    return {instance, primitive, rank - first_rank[primitive]};
  }
  /// Returns the rank of the triangle, or UINT32_MAX if the mesh has no such triangle.
  std::uint32_t rank(const TriangleId& id) const {
    if (id.primitive + std::size_t{1} >= first_rank.size()) return UINT32_MAX;
    const std::uint32_t first = first_rank[id.primitive], next = first_rank[id.primitive + 1];
    return id.triangle < next - first ? first + id.triangle : UINT32_MAX;
  }
};

inline constexpr std::uint32_t kNoMotion = UINT32_MAX;

/// An instance of a mesh, or a solid.
struct PlacedMesh {
  Affine3d world_to_object;
  std::uint32_t mesh = 0, instance = 0;
  bool identity = false;
  std::uint32_t solid = kNoSolid;    // index in SceneBvh::solids, if it is not a mesh
  std::uint32_t motion = kNoMotion;  // index in SceneBvh::motions, if it moves
};

/// The two-level BVH of a scene: a tree over placed meshes, whose leaves are elements of `placed`,
/// and the trees of the meshes. Solids without finite bounds are beside the tree.
template <int kWidth>
struct SceneBvh {
  std::vector<MeshBvh<kWidth>> meshes;
  std::vector<PlacedMesh> placed;
  std::vector<PlacedMesh> unbounded;  // solids that every ray is tested against
  HugeArray<WideNode<kWidth>> nodes;
  std::shared_ptr<const Solids> solids;          // null in a scene without solids
  std::vector<std::array<Affine3d, 2>> motions;  // object to world at two successive keyframes
  Box3f bounds;                                  // of the padded boxes of the placed meshes
  float origin_limit = 0;  // the padding covers ray origins up to this size, per axis
  bool single = false;     // only one placed mesh: queries skip the nodes above it
};

/// Everything that moves during the exposure: a BVH for each interval between keyframes, with boxes
/// around the whole motion in it. Still instances are in a SceneBvh of their own.
template <int kWidth>
struct MotionBvh {
  std::vector<float> times;                // of keyframes; empty if nothing moves
  std::vector<SceneBvh<kWidth>> segments;  // by interval: one less than times
};

}  // namespace tessera::render
