#pragma once

#include <string>
#include <vector>

#include "contract/hilbert.h"
#include "tests/bench/accel/workload/scenes.h"
#include "worker/accel/scene_accel.h"

namespace tessera::render::bench {

/// Rays of one kind, in the order in which a renderer traces them.
struct RaySet {
  std::string kind;
  bool any = false;     // for any-hit queries instead of closest-hit queries
  bool camera = false;  // coherent rays from one point
  std::vector<Ray> rays;
};

/// The square view of a scene; `half` is the tangent of half its angle of view.
struct View {
  explicit View(const BenchScene& scene);
  /// Returns the ray through (x, y), each in [0, 1]; y points downwards.
  Ray ray(float x, float y) const;

  Vec3f eye, forward, right, up;
  float half;
};

/// Generates rays through the centres of the side x side pixels of a view, in the given order.
std::vector<Ray> centre_rays(const BenchScene& scene, int side,
                             const std::vector<contract::GridPoint>& order);

/// Generates the sets camera (along the Hilbert curve), bounce1 and bounce2 (diffuse), shadow1 and
/// shadow2 (from the hits of camera and bounce1 to a rectangle). Deterministic, since hits do not
/// depend on the structure.
std::vector<RaySet> make_rays(const BenchScene& scene, const SceneAccel& accel, int side);

}  // namespace tessera::render::bench
