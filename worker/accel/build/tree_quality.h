#pragma once

#include "worker/accel/layout/scene_bvh.h"

namespace tessera::render {

/// How good a tree ought to be, in nodes and blocks that a ray through its box is expected to test.
/// Without triangles all is 0.
struct TreeQuality {
  /// Surface area heuristic: for rays that come from everywhere and hit nothing.
  double sah = 0;
  /// End-point overlap: what a ray that ends on the surface tests for the sake of triangles in
  /// boxes around its end which these do not belong to.
  /// Source: T. Aila, T. Karras, S. Laine, "On quality metrics of bounding volume hierarchies",
  /// 2013. Over at most 20,000 triangles, spread over the mesh.
  double end_point_overlap = 0;
};

/// Its TreeQuality::sah.
template <int kWidth>
double sah_of(const MeshBvh<kWidth>& tree);

template <int kWidth>
TreeQuality quality_of(const MeshBvh<kWidth>& tree);

extern template double sah_of<8>(const MeshBvh<8>&);
extern template double sah_of<16>(const MeshBvh<16>&);
extern template TreeQuality quality_of<8>(const MeshBvh<8>&);
extern template TreeQuality quality_of<16>(const MeshBvh<16>&);

}  // namespace tessera::render
