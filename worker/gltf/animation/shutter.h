#pragma once

#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/animation/animation.h"
#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// While the shutter of a frame is open.
struct ShutterInterval {
  double open = 0, close = 0;         // seconds; open < close
  std::vector<AnimationKey> changes;  // in between, in order: where motion may turn or jump
  /// The scene at a time, recentred as at the frame's own.
  std::function<absl::StatusOr<Scene>(double seconds)> pose;
};

/// Gives `scene` what moves meanwhile: Scene::key_times and motions, keys of meshes, lights and the
/// camera.
///
/// Keys are where the animation has some and halfway between two, again and again, until the true
/// poses a quarter and three quarters of the way lie within a tolerance of the straight line: 2^-10
/// of the size of what moves; for cameras and punctual lights 2^-12 radians and 2^-12 of the
/// scene's size. For paths that are cubic in time no point is then off by more than 4/3 of it: with
/// e(s) = s (1 - s) (a + b s) known at 1/4 and 3/4, |e| <= 4/3 max in [0, 1]. No more keys than
/// kMaxKeys, with a warning. A jump (STEP) is two keys with no time a ray can have in between.
///
/// Errors: InvalidArgument where a pose fails or the keys take too much memory.
absl::Status add_motion(const ShutterInterval& exposure, Scene& scene, std::vector<Problem>& problems);

inline constexpr std::size_t kMaxKeys = 129;

}  // namespace tessera::render
