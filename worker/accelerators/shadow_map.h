#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/bounds.h"

namespace tessera::render {

/// Maps of the depths seen from the scene's lights: a cube for a point or spot light, one square
/// across the scene for a directional light. They answer shadow rays only where bounds prove the
/// answer, so that it always equals that of SceneAccel; all other rays are traced. Renders do not
/// use them; docs/notes/accelerators-compared.md has the measurements. Source: L. Williams,
/// "Casting curved shadows on curved surfaces", 1978.
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
  /// Bounds on the depths at which lines of light through a texel and its neighbours meet
  /// triangles.
  struct Texel {
    double nearest, second;  // smallest depths of two different triangles
    TriangleId id;           // the nearest one
    double covered;          // all these lines meet one triangle at this depth or before

    void add(const TriangleId& triangle, double depth);
  };
  struct Map {
    bool distant = false;
    Vec3d light;                // position; for a directional light, the middle of the scene
    Vec3f to_light;             // of a directional light
    std::array<Vec3d, 3> axes;  // of a directional light: across, divided by `half`, and along
    double half = 0;            // of a directional light: half the side of its square
    double nearest = 0;         // smallest depth of all texels
    std::vector<Texel> texels;  // by face, row and column

    int faces() const { return distant ? 1 : 6; }
    int side() const { return distant ? 256 : 64; }  // texels along a face
    /// A point on a face: coordinates across, multiplied by the third, and the depth.
    struct OnFace {
      Vec3d across;
      double depth = 0;
    };
    OnFace place(const Vec3d& point, int face) const;
    int face_of(const Vec3d& point) const;
    /// Half the width of a texel where a ray has its first hit, or less, and `error` off.
    bool resolves(double error) const;
  };
  using Corners = std::array<Vec3d, 3>;

  template <typename Visit>
  static void for_each_placed(const Scene& scene, const Visit& visit);
  void add_map(const PunctualLight& light, const Box3d& box);
  static void add(const Corners& placed, const TriangleId& id, Map& map);
  Answer answer(const Map& map, const Ray& ray, double error) const;

  std::vector<Map> maps_;
  double size_ = 0;     // of the scene, and of coordinates before they are placed
  double stretch_ = 1;  // how much transforms of instances magnify relative rounding errors
};

}  // namespace tessera::render
