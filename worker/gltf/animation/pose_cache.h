#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "worker/gltf/decode/geometry_reader.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Bounding box in double; empty until a point is added.
struct PosedBox {
  Vec3d low = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};

  void add(const Vec3d& p) {
    low = min(low, p);
    high = max(high, p);
  }
  [[nodiscard]] bool is_empty() const { return !(low.x <= high.x); }
};

/// Results of one pose that the next may reuse: images, posed meshes and the base meshes of
/// deforming ones, each a function of the file and its key. A pose keeps only the entries it used,
/// so the cache never holds more than one frame, and it shares all but the bases with that frame.
struct PoseCache {
  /// glTF mesh, variant (or kNone), morph weights.
  using MeshKey = std::tuple<std::int32_t, std::int32_t, std::vector<double>>;
  struct PosedMesh {
    Mesh mesh;
    PosedBox box;  // object space
  };
  /// glTF mesh, variant, primitive.
  using BaseKey = std::tuple<std::int32_t, std::int32_t, std::size_t>;

  std::map<std::int32_t, Image> images;                           // by glTF image
  std::map<MeshKey, PosedMesh> meshes;                            // meshes without a skin
  std::map<BaseKey, std::shared_ptr<const BasePrimitive>> bases;  // null: no triangles
};

}  // namespace tessera::render
