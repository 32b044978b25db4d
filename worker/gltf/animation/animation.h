#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Indices of the animations that `selection` names: a name, an index, "all", "none", or empty for
/// the first. Errors: InvalidArgument if there is no such animation.
absl::StatusOr<std::vector<std::int32_t>> choose_animations(const GltfModel& model,
                                                            const std::string& selection);

/// Time of an animation's last key, seconds. Requires check_animations().
double clip_seconds(const GltfModel& model, std::int32_t animation);

/// Time of an animation key and whether the animated value jumps there (STEP).
struct AnimationKey {
  double seconds = 0;
  bool jumps = false;
};

/// Keys of node animations in the open interval (from, to), sorted, with one entry per time.
/// Requires check_animations().
std::vector<AnimationKey> animation_keys(const GltfModel& model,
                                         const std::vector<std::int32_t>& animations, double from,
                                         double to);

/// Checks that key times are finite and increase, and that outputs have the right shape and are
/// finite. Adds animations that fail to model.faults and removes their channels.
void check_animations(GltfModel& model);

/// Sets the animated properties of `nodes` to their values at `seconds`, clamped to the keys of
/// each channel. Interpolation (step, linear or spherical, cubic spline) follows the glTF 2.0
/// specification, appendix C. Requires check_animations().
absl::Status animate(const GltfModel& model, std::int32_t animation, double seconds,
                     std::vector<Node>& nodes);

/// Values of a pointer channel at `seconds`. Requires check_animations().
absl::StatusOr<std::vector<double>> pointer_values(const GltfModel& model, std::int32_t animation,
                                                   const PointerChannel& channel, double seconds);

/// Spherical interpolation from a to b along the shorter arc, f in [0, 1]; unit if a and b are.
Vec4d slerp(const Vec4d& a, Vec4d b, double f);

}  // namespace tessera::render
