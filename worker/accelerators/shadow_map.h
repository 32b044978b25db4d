#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// Cube maps of the depths seen from the scene's point and spot lights. They answer shadow rays
/// only where bounds prove the answer, so that it is that of SceneAccel; all other rays are traced.
/// Renders do not use them; docs/notes/accelerators-compared.md has the measurements.
/// Source: L. Williams, "Casting curved shadows on curved surfaces", 1978.
class ShadowMap {
 public:
  enum class Answer : std::uint8_t { visible, occluded, unknown };

  /// Holds maps of at most 16 lights that do not move, in a scene whose objects are still meshes;
  /// else no map.
  explicit ShadowMap(const Scene& scene);

  /// Returns what is certain about a shadow ray without a filter, by the map of the light at its
  /// end.
  Answer answer(const Ray& ray) const;
  std::int64_t memory_bytes() const;

 private:
  /// Bounds on the depths, along the face's axis, at which lines from the light through a texel and
  /// its neighbours meet triangles.
  struct Texel {
    double nearest, second;  // smallest depths of two different triangles
    TriangleId id;           // the nearest one
    double covered;          // all these lines meet one triangle at this depth or before

    void add(const TriangleId& triangle, double depth);
  };
  struct Map {
    Vec3d light;
    double nearest;             // smallest depth of all texels
    std::vector<Texel> texels;  // by face, row and column
  };
  using Corners = std::array<Vec3d, 3>;

  void add(const Scene& scene, std::uint32_t number);  // an instance
  static void add(const Corners& placed, const TriangleId& id, Map& map);

  std::vector<Map> maps_;
  double size_ = 0;     // of the scene, and of coordinates before they are placed
  double stretch_ = 1;  // how much transforms of instances magnify relative rounding errors
};

}  // namespace tessera::render
