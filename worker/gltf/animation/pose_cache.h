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

/// A box in double; empty until something is added.
struct PosedBox {
  Vec3d low = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};

  void add(const Vec3d& p) {
    low = min(low, p);
    high = max(high, p);
  }
  [[nodiscard]] bool is_empty() const { return !(low.x <= high.x); }
};

/// What one pose decoded and the next may need again: images, meshes as they stand, and what those
/// that deform are made of. Each is a function of the file and its key. A pose hands on only what
/// it used itself, so this never holds more than one frame's worth; and what it holds is shared
/// with that frame, but for the bases.
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
  std::map<MeshKey, PosedMesh> meshes;                            // without a skin
  std::map<BaseKey, std::shared_ptr<const BasePrimitive>> bases;  // null: has no triangles
};

}  // namespace tessera::render
