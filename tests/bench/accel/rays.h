#pragma once

#include <string>
#include <vector>

#include "contract/hilbert.h"
#include "tests/bench/accel/scenes.h"
#include "worker/accel/scene_accel.h"

namespace tessera::render::bench {

/// Rays of one kind, in the order a renderer would trace them.
struct RaySet {
  std::string kind;
  bool any = false;     // whether anything is hit, rather than what is hit first
  bool camera = false;  // coherent: runs of 16 start at one point
  std::vector<Ray> rays;
};

/// The square view of a scene; `half` is the tangent of half its angle.
struct View {
  explicit View(const BenchScene& scene);
  /// Through (x, y) in [0, 1], y downwards.
  Ray ray(float x, float y) const;

  Vec3f eye, forward, right, up;
  float half;
};

/// A ray through the centre of each pixel of a view of so many a side.
std::vector<Ray> centre_rays(const BenchScene& scene, int side,
                             const std::vector<contract::GridPoint>& order);

/// camera (along the Hilbert curve), bounce1, bounce2 (diffuse), shadow1, shadow2 (from the
/// camera's hits and from those of the first bounce to a rectangle). Deterministic: hits do not
/// depend on the structure.
std::vector<RaySet> make_rays(const BenchScene& scene, const SceneAccel& accel, int side);

}  // namespace tessera::render::bench
