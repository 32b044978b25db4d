#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/animation/animation.h"
#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Exposure of a frame.
struct ShutterInterval {
  double open = 0, close = 0;         // seconds; open < close
  std::vector<AnimationKey> changes;  // animation keys in between, sorted
  /// Returns the scene at a time, with the centre of the frame's own time.
  std::function<absl::StatusOr<Scene>(double seconds)> pose;
  std::uint64_t memory_bytes = UINT64_MAX;  // that the poses may take
};

/// Adds the motion during the exposure to `scene`: Scene::key_times and motions, and keys of
/// meshes, lights and the camera.
///
/// Keys are placed at animation keys and then by bisection, until the true poses at one and three
/// quarters of each interval lie within a tolerance of linear interpolation: 2^-10 of the size of
/// the moving object; for cameras and punctual lights 2^-12 radians and 2^-12 of the scene's size.
/// For paths that are cubic in time the error is then at most 4/3 of it everywhere: with e(s) = s
/// (1 - s) (a + b s) known at 1/4 and 3/4, |e| <= 4/3 max in [0, 1]. At kMaxKeys keys it stops with
/// a warning. A jump (STEP) is two keys with no representable ray time in between.
///
/// Errors: those of a pose; InvalidArgument or, if only this machine has too little memory for the
/// keys, ResourceExhausted.
absl::Status add_motion(const ShutterInterval& exposure, Scene& scene,
                        std::vector<Problem>& problems);

/// Maximum number of keys: 128 linear segments.
inline constexpr std::size_t kMaxKeys = 129;

}  // namespace tessera::render
