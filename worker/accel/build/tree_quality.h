#pragma once

#include "worker/accel/layout/scene_bvh.h"

namespace tessera::render {

/// Predicted cost of a BVH: the expected numbers of nodes and blocks that a ray through its box
/// tests. All 0 without triangles.
struct TreeQuality {
  /// Surface area heuristic: for uniformly distributed rays that hit nothing.
  double sah = 0;
  /// End-point overlap: additional tests for a ray that ends on a triangle, of boxes that contain
  /// this end point but not the triangle. Estimated from at most 20,000 triangles, spread over the
  /// mesh. Source: T. Aila, T. Karras, S. Laine, "On quality metrics of bounding volume
  /// hierarchies", 2013.
  double end_point_overlap = 0;
};

/// Returns TreeQuality::sah of a tree.
template <int kWidth>
double sah_cost(const MeshBvh<kWidth>& tree);

template <int kWidth>
TreeQuality measure_tree_quality(const MeshBvh<kWidth>& tree);

extern template double sah_cost<8>(const MeshBvh<8>&);
extern template double sah_cost<16>(const MeshBvh<16>&);
extern template TreeQuality measure_tree_quality<8>(const MeshBvh<8>&);
extern template TreeQuality measure_tree_quality<16>(const MeshBvh<16>&);

}  // namespace tessera::render
