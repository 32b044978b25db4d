#pragma once

#include <string>
#include <vector>

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

/// camera (along the Hilbert curve), bounce1, bounce2 (diffuse), shadow1, shadow2 (from the
/// camera's hits and from those of the first bounce to a rectangle). Deterministic: hits do not
/// depend on the structure.
std::vector<RaySet> make_rays(const BenchScene& scene, const SceneAccel& accel, int side);

}  // namespace tessera::render::bench
