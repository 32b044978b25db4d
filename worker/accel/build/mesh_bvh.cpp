#include "worker/accel/build/mesh_bvh.h"

#include <array>
#include <vector>

#include "worker/accel/binary_bvh/reinsertion.h"
#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/build/tree_quality.h"
#include "worker/accel/build/wide_bvh.h"

namespace tessera::render {
namespace {

/// Number of references per triangle that spatial splits may add.
constexpr double kSplitBudget = 0.5;
/// More passes gain little: docs/notes/rays-against-embree.md.
constexpr int kReinsertionPasses = 2;

/// The triangles of a mesh that can be hit, each with its rank.
struct Triangles {
  std::vector<std::array<Vec3f, 3>> corners;
  std::vector<std::uint32_t> ranks;
  std::vector<Box3f> boxes;
};

Triangles gather(const Mesh& mesh, const std::vector<std::uint32_t>& first_rank) {
  Triangles out;
  out.corners.reserve(first_rank.back());
  out.ranks.reserve(first_rank.back());
  out.boxes.reserve(first_rank.back());
  for_each_triangle(mesh, [&](std::uint32_t p, std::uint32_t t, const Vec3f& v0, const Vec3f& v1,
                              const Vec3f& v2) {
    out.corners.push_back({v0, v1, v2});
    out.ranks.push_back(first_rank[p] + t);
    out.boxes.push_back({min(min(v0, v1), v2), max(max(v0, v1), v2)});
  });
  return out;
}

/// Returns the bounding box of the part of a triangle with lo <= x[axis] <= hi, up to the rounding
/// of new corners.
Box3f clip_triangle(const std::array<Vec3f, 3>& corners, int axis, float lo, float hi) {
  Box3f box;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3f &a = corners[i], &b = corners[i == 2 ? 0 : i + 1];
    const float from = a[axis], to = b[axis];
    if (from >= lo && from <= hi) box.extend(a);
    for (const float plane : {lo, hi}) {
      if (!((from < plane && plane < to) || (to < plane && plane < from))) continue;
      const double s = (static_cast<double>(plane) - static_cast<double>(from)) /
                       (static_cast<double>(to) - static_cast<double>(from));
      Vec3f p(Vec3d(a) + (Vec3d(b) - Vec3d(a)) * s);
      p[axis] = plane;
      box.extend(p);
    }
  }
  return box;
}

/// Extends the boxes of the slabs by a triangle's corners and its edges' intersections with the
/// planes.
void chop_triangle(const std::array<Vec3f, 3>& corners, const Slabs& slabs, PackedBox* parts) {
  const auto lanes = [](const Vec3f& v) { return _mm_setr_ps(v.x, v.y, v.z, 0); };
  const int axis = slabs.axis, count = static_cast<int>(slabs.planes.size()) - 1;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3f &a = corners[i], &b = corners[i == 2 ? 0 : i + 1];
    const float from = a[axis], size = b[axis] - from;
    const __m128 start = lanes(a), edge = _mm_sub_ps(lanes(b), start);
    for (int plane = 0; plane <= count; ++plane) {
      const float s = (slabs.planes[static_cast<std::size_t>(plane)] - from) / size;
      if (plane < count && from >= slabs.planes[static_cast<std::size_t>(plane)] &&
          from <= slabs.planes[static_cast<std::size_t>(plane) + 1]) {
        parts[plane].extend(PackedBox(start));
      }
      if (!(s > 0 && s < 1)) continue;
      const PackedBox point(_mm_fmadd_ps(edge, _mm_set1_ps(s), start));
      if (plane > 0) parts[plane - 1].extend(point);
      if (plane < count) parts[plane].extend(point);
    }
  }
}

class TriangleCutter final : public ItemCutter {
 public:
  explicit TriangleCutter(const std::vector<std::array<Vec3f, 3>>& corners) : corners_(corners) {}

  Box3f clip(std::uint32_t item, int axis, float lo, float hi) const override {
    return clip_triangle(corners_[item], axis, lo, hi);
  }
  void chop(std::uint32_t item, const Slabs& slabs, PackedBox* parts) const override {
    chop_triangle(corners_[item], slabs, parts);
  }

 private:
  const std::vector<std::array<Vec3f, 3>>& corners_;
};

TriangleBlock make_block(const Triangles& triangles, std::span<const std::uint32_t> items) {
  TriangleBlock block;
  for (std::size_t lane = 0; lane < items.size(); ++lane) {
    block.set(lane, triangles.corners[items[lane]], triangles.ranks[items[lane]]);
  }
  return block;
}

}  // namespace

template <int kWidth>
MeshBvh<kWidth> build_mesh_bvh(const Mesh& mesh, const ParallelFor& parallel_for,
                               BuildQuality quality) {
  MeshBvh<kWidth> tree;
  tree.first_rank = {0};
  for (const Primitive& p : mesh.primitives) {
    tree.first_rank.push_back(tree.first_rank.back() +
                              static_cast<std::uint32_t>(p.triangles.size()));
  }
  const Triangles triangles = gather(mesh, tree.first_rank);
  const TriangleCutter cutter(triangles.corners);
  BinaryBvhInput input = {triangles.boxes, kBlockSize};
  if (quality != BuildQuality::fast) {
    input.cut = &cutter;
    input.split_budget = kSplitBudget;
  }
  BinaryBvh binary = build_binary_bvh(input, parallel_for);
  if (quality == BuildQuality::high) reinsert_subtrees(binary, kReinsertionPasses);
  WideBvh<kWidth> bvh = collapse<kWidth>(binary);
  tree.nodes = std::move(bvh.nodes);
  tree.bounds = bvh.bounds;
  tree.split = bvh.order.size() > triangles.boxes.size();
  tree.blocks = HugeArray<TriangleBlock>(bvh.leaves.size());
  for (std::size_t i = 0; i < bvh.leaves.size(); ++i) {
    const BvhLeaf& leaf = bvh.leaves[i];
    tree.blocks[i] = make_block(triangles, std::span(bvh.order).subspan(leaf.first, leaf.count));
  }
  tree.triangle_count = static_cast<std::uint32_t>(triangles.boxes.size());
  tree.built_sah = sah_cost(tree);
  return tree;
}

template MeshBvh<8> build_mesh_bvh<8>(const Mesh&, const ParallelFor&, BuildQuality);
template MeshBvh<16> build_mesh_bvh<16>(const Mesh&, const ParallelFor&, BuildQuality);

}  // namespace tessera::render
