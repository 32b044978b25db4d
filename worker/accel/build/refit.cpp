#include "worker/accel/build/refit.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/build/tree_quality.h"

namespace tessera::render {
namespace {

/// Maximum SAH cost of a refitted tree, relative to the tree as built.
constexpr double kMaxGrowth = 1.05;

/// The corners of a mesh's triangles and whether they can be hit, by rank.
struct Corners {
  std::vector<std::array<Vec3f, 3>> by_rank;
  std::vector<bool> hittable;
  std::uint32_t count = 0;
};

Corners corners_of(const Mesh& mesh, const std::vector<std::uint32_t>& first_rank) {
  Corners out;
  out.by_rank.resize(first_rank.back());
  out.hittable.resize(first_rank.back());
  for_each_triangle(mesh, [&](std::uint32_t p, std::uint32_t t, const Vec3f& v0, const Vec3f& v1,
                              const Vec3f& v2) {
    out.by_rank[first_rank[p] + t] = {v0, v1, v2};
    out.hittable[first_rank[p] + t] = true;
    ++out.count;
  });
  return out;
}

/// Returns whether the triangles of `mesh` have the same ranks as in the BVH with this first_rank.
bool same_ranks(const std::vector<std::uint32_t>& first_rank, const Mesh& mesh) {
  if (first_rank.size() != mesh.primitives.size() + 1) return false;
  for (std::size_t i = 0; i < mesh.primitives.size(); ++i) {
    if (first_rank[i + 1] - first_rank[i] != mesh.primitives[i].triangles.size()) return false;
  }
  return true;
}

/// Updates the triangles of a block and extends `box` by them; returns false if one can no longer
/// be hit.
bool refit_block(const Corners& corners, TriangleBlock& block, Box3f& box) {
  for (std::size_t lane = 0; lane < kBlockSize; ++lane) {
    if (!block.has_triangle(lane)) continue;
    if (!corners.hittable[block.rank[lane]]) return false;
    const auto& triangle = corners.by_rank[block.rank[lane]];
    block.set(lane, triangle, block.rank[lane]);
    for (const Vec3f& corner : triangle) box.extend(corner);
  }
  return true;
}

template <typename T>
HugeArray<T> copy_of(const HugeArray<T>& from) {
  HugeArray<T> to(from.size());
  std::copy(from.data(), from.data() + from.size(), to.data());
  return to;
}

/// Recomputes the boxes of all nodes from the leaves up. Children are stored after their parents,
/// so reverse storage order suffices.
template <int kWidth>
void refit_nodes(const std::vector<Box3f>& leaves, MeshBvh<kWidth>& tree) {
  std::vector<Box3f> boxes(tree.nodes.size());
  for (std::size_t i = tree.nodes.size(); i-- > 0;) {
    WideNode<kWidth>& node = tree.nodes[i];
    for (int slot = 0; slot < kWidth; ++slot) {
      if (node.box(slot).empty()) continue;
      const std::uint32_t child = node.children[slot];
      const Box3f& box =
          (child & kLeafBit) != 0 ? leaves[child & ~kLeafBit] : boxes[child / kNodeUnits<kWidth>];
      node.set_child(slot, box, child);
      boxes[i].extend(box);
    }
  }
  tree.bounds = boxes[0];
}

}  // namespace

template <int kWidth>
std::optional<MeshBvh<kWidth>> refit_mesh_bvh(const MeshBvh<kWidth>& before, const Mesh& mesh) {
  if (before.blocks.empty() || !same_ranks(before.first_rank, mesh)) return std::nullopt;
  const Corners corners = corners_of(mesh, before.first_rank);
  if (corners.count != before.triangle_count) return std::nullopt;
  MeshBvh<kWidth> tree = before;
  tree.nodes = copy_of(before.nodes);
  tree.blocks = copy_of(before.blocks);
  std::vector<Box3f> leaves(tree.blocks.size());
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (!refit_block(corners, tree.blocks[i], leaves[i])) return std::nullopt;
  }
  refit_nodes(leaves, tree);
  if (!(sah_cost(tree) <= kMaxGrowth * before.built_sah)) return std::nullopt;
  return tree;
}

template std::optional<MeshBvh<8>> refit_mesh_bvh<8>(const MeshBvh<8>&, const Mesh&);
template std::optional<MeshBvh<16>> refit_mesh_bvh<16>(const MeshBvh<16>&, const Mesh&);

}  // namespace tessera::render
