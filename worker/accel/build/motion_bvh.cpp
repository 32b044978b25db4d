#include "worker/accel/build/motion_bvh.h"

#include <vector>

#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/build/wide_bvh.h"

namespace tessera::render {

template <int kWidth>
MeshBvh<kWidth> build_moving_mesh_bvh(const Mesh& mesh, std::uint32_t segment,
                                      const ParallelFor& parallel_for) {
  MeshBvh<kWidth> tree;
  tree.first_rank = {0};
  for (const Primitive& p : mesh.primitives) {
    tree.first_rank.push_back(tree.first_rank.back() +
                              static_cast<std::uint32_t>(p.triangles.size()));
  }
  std::vector<MovingTriangle> triangles;
  std::vector<std::uint32_t> ranks;
  std::vector<Box3f> boxes;
  for_each_triangle(mesh, segment,
                    [&](std::uint32_t p, std::uint32_t t, const MovingTriangle& triangle) {
                      triangles.push_back(triangle);
                      ranks.push_back(tree.first_rank[p] + t);
                      boxes.push_back(triangle.box());
                    });
  WideBvh<kWidth> bvh = collapse<kWidth>(build_binary_bvh({boxes, kBlockSize}, parallel_for));
  tree.nodes = std::move(bvh.nodes);
  tree.bounds = bvh.bounds;
  tree.blocks = HugeArray<TriangleBlock>(bvh.leaves.size());
  tree.end_blocks = HugeArray<TriangleBlock>(bvh.leaves.size());
  for (std::size_t i = 0; i < bvh.leaves.size(); ++i) {
    const BvhLeaf& leaf = bvh.leaves[i];
    for (std::uint32_t lane = 0; lane < leaf.count; ++lane) {
      const std::uint32_t item = bvh.order[leaf.first + lane];
      tree.blocks[i].set(lane, triangles[item].from, ranks[item]);
      tree.end_blocks[i].set(lane, triangles[item].to, ranks[item]);
    }
  }
  tree.triangle_count = static_cast<std::uint32_t>(triangles.size());
  return tree;
}

template MeshBvh<8> build_moving_mesh_bvh<8>(const Mesh&, std::uint32_t, const ParallelFor&);
template MeshBvh<16> build_moving_mesh_bvh<16>(const Mesh&, std::uint32_t, const ParallelFor&);

}  // namespace tessera::render
